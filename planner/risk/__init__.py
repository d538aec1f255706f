"""Risk: call the predictor, and turn its prediction into a risk map and a cost map.

`risk_map` decides which cells a plan (at ε) and its last resort (at λ) may enter. The level λ comes
from a `calibration`, and `adaptive_level` lowers it during a drive. `cost_map` is for the route.
"""
