"""Selection of modes: forces of contacts in a mode, the laws that they obey, and the search for a lawful mode."""
