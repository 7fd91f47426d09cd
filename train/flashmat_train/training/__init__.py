"""What the `train` stage is made of: setting up, validating, the step with its guard, the loop."""
