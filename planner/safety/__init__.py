"""Safety: choose among plans that pass the collision test, and always keep a way to stop."""
