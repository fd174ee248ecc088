"""What all tests share: hypothesis without deadlines, and the same examples in every CI run."""

import os

from hypothesis import settings

# No deadline: a slow machine is no failure. In CI the examples are the same each time, so that a
# change is judged by itself; at a desk they are new ones, which is how property tests find things.
settings.register_profile("desk", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "desk")
