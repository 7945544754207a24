"""What a user does with an accepted task: environments, demonstrations, exports, variations, grades."""
