"""MPC: plan motions along the path that end with the car stopped.

`initial_guess` makes the first controls by pure pursuit, and `mpc` improves them by sequential
quadratic programming (SQP). `stages` defines the dynamics and the cost of a stage, and `references`
where on the path it should be. `merit` is the cost of a plan, and `clearance` measures how close it
passes to unsafe cells. `codegen` compiles the derivatives of the stages, `condense` turns them into
a dense QP in the controls, and `constraints` adds the car's limits and the clearance.
"""
