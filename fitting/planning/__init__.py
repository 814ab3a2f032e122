"""What a motion will show: forecast, detection thresholds, the next experiment."""
