"""Plants that come as functional mock-up units (FMI 2.0 and 3.0); the only place that knows fmpy."""
