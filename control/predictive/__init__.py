"""The predictive lock: controller, internal model, target prediction."""
