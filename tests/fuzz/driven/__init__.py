"""Random scenes with contacts, driven: by inputs, functions of time, controllers, and maps of the state at events."""
