"""Data of integration methods: tableaux, order conditions, statuses, constants of step size control."""
