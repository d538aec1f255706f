"""The study of the risk dial: requested against realised risk, and speed against collisions."""
