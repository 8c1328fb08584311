"""Where on a known road is the vehicle? The road, the gyro, the filter, and what it costs."""
