"""How the planner drives: `stuck` drives, and weaving (`weave`)."""
