from . import rollout_film as rollout_film
from .recorded_motion import recover_joint_positions as recover_joint_positions
from .recorded_motion import show_recorded_frame as show_recorded_frame
from .rollout_film import Shot as Shot
from .rollout_film import find_recorded_rollout as find_recorded_rollout
from .rollout_film import play_in_mujoco_window as play_in_mujoco_window
from .rollout_film import render_frames as render_frames
from .rollout_film import write_film as write_film
