"""Lower and upper bounds of the time that a car needs, with the whole map known."""
