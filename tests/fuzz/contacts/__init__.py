"""Random scenes with contacts, compared with Moreau-Jean time stepping."""
