"""Uses of an accepted task: environments, demonstrations, exports, variations, grades."""
