from .controls import JointPositionControl as JointPositionControl
from .gym_environment import GrsEnv as GrsEnv
from .lerobot import make_env as make_env
from .pictures import Photographer as Photographer
from .state import StateReader as StateReader
from .task_episode import SOLVED as SOLVED
from .task_episode import TaskEpisode as TaskEpisode
