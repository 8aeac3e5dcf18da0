"""The target lock as an environment for reinforcement learning."""
