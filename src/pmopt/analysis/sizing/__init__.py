"""The rates and efforts that actuators need anywhere in the workspace."""
