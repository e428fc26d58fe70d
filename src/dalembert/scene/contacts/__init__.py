"""Contacts of a scene: their laws, and contacts by geometry, which become joints and laws."""
