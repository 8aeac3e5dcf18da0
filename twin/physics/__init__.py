"""The simulated plant and its motors, and the closed forms that verify them."""
