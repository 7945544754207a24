"""The described scene in MuJoCo: how it comes to rest, and how it compares with the photo."""
