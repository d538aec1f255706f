"""The evidence for what the documents state; in a checkout only, and nothing imports it.

- `katyal2018`: the prediction study of Katyal et al. 2018.
- `worth`: what prediction is worth against baselines without a network.
- `risk`: requested and realised risk of collisions.
- `buildings`: generated buildings against real ones.
- `suites`: the suites of the race.
- `performance`: times, memory and throughput.
- `robustness`: hostile predictors, interrupted commands.
- `contact_test`: whether a drive touched anything, for the studies of risk and robustness.
- `driver`: why drives got stuck, how much the car weaves, how far it relied on predictions.
"""
