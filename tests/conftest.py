"""Settings of the test run."""

from hypothesis import settings

# The first call of a compiled kernel takes long, and machines that run tests are busy.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")
