"""The poses in reach: volume, index, shape, positions; why there are none."""
