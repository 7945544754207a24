"""Objects that no asset fits: shapes made from what the camera saw, in free space."""
