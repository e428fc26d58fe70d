"""Independent references: nothing in this folder imports dalembert."""
