"""Safety: test plans, choose one of them, and always keep a manoeuvre that stops the car.

`collision` tests whether the body stays in the safe set along a plan, with the kernels in
`contact`. `plan_choice` lets the MPC compute plans, and chooses among those that pass the test.
`last_resort` slows the chosen plan down if the car could otherwise no longer stop within certain
cells. `limiting_factor` says what keeps the car from going faster.
"""
