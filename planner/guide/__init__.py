"""Guide: find a way to the goal on the cost map, and a smooth line along it."""
