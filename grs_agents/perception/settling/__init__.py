"""The described scene in MuJoCo: collisions, rest poses, relations, and the comparison with the photo."""
