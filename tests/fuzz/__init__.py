"""Random scenes and an independent reference for them: ``make fuzz`` compares both (see docs/reliability.md)."""
