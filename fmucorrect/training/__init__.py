"""Training of correctors: the only place that knows torch. Ends in a bundle, which the stepper loads."""
