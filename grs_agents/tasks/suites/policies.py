"""Policies under evaluation: the expert, random actions, a class, a checkpoint of LeRobot, a server of openpi's."""

import importlib
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol, cast

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import GrsError, InputError, UnknownNameError
from grs_agents.library.library import Library
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.tasks.demos.production import expert_actions, record_expert
from grs_agents.tasks.envs.controls import LARGEST_VELOCITY, JointVelocityControl
from grs_agents.tasks.envs.task_episode import TaskEpisode
from grs_agents.tasks.suites.layouts import Layout, Observation
from grs_agents.tasks.suites.lerobot_checkpoint import LerobotCheckpoint, fit_layout
from grs_agents.tasks.suites.openpi_client import OpenpiClient

NAMES: Final = ("oracle", "random", "lerobot:PATH", "openpi:ws://HOST:PORT", "package.module:Class")
OWN_UNITS: Final = ("oracle", "random")
"""Policies that act in the units of the control, whatever the layout."""
_CLASS = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


class PolicyFailure(GrsError):
    """A policy gave no usable action; the episode ends with this outcome."""

    def __init__(self, outcome: str, message: str) -> None:
        super().__init__(message)
        self.outcome = outcome


@dataclass(frozen=True)
class EpisodeStart:
    """An episode as it begins; only trusted policies use more than the instruction."""

    instruction: str
    instance: TaskInstance
    library: Library
    low: npt.NDArray[np.float64]  # (D,) bounds of an action
    high: npt.NDArray[np.float64]
    seed: int  # of the episode's random draws


class Policy(Protocol):
    """Acts on observations, episode after episode."""

    def reset(self, start: EpisodeStart) -> None:
        """An episode begins."""
        ...

    def act(self, observation: Observation) -> Any:
        """An action (D,), a chunk of actions (T, D), or a reply that the layout reads them from."""
        ...


class RandomPolicy:
    """Uniform actions within the bounds."""

    def reset(self, start: EpisodeStart) -> None:
        """Seed the draws."""
        self._rng, self._start = np.random.default_rng(start.seed), start

    def act(self, observation: Observation) -> npt.NDArray[np.float64]:
        """A random action (D,)."""
        return self._rng.uniform(self._start.low, self._start.high)


class ExpertPolicy:
    """The expert's episode, replayed through the control ``joint_position`` or ``joint_velocity``.

    A class derived from it, named as a policy, gets the whole `EpisodeStart`: an expert with a fault of one's own.
    """

    def __init__(self, control: str = "joint_position") -> None:
        if control not in ("joint_position", "joint_velocity"):
            raise InputError(f"the policy oracle does not act by {control}", "use a layout with joint_position")
        self._control = control

    def reset(self, start: EpisodeStart) -> None:
        """Let the expert solve the episode on a table of its own."""
        episode = TaskEpisode(start.library)
        episode.begin(start.instance)
        positions, held, grip = record_expert(episode.current)
        timestep, arm = start.instance.timestep, episode.sim.arm
        rate = JointVelocityControl(arm, timestep).rate if self._control == "joint_velocity" else 25.0
        self._actions = expert_actions(positions, held, grip, round(1 / (rate * timestep))).astype(np.float64)
        if self._control == "joint_velocity":
            before = np.vstack([positions[:1], self._actions[:-1, :-1]])
            self._actions[:, :-1] = (self._actions[:, :-1] - before) * (rate / LARGEST_VELOCITY)
        self._next = 0

    def act(self, observation: Observation) -> npt.NDArray[np.float64]:
        """The next action (D,); after the last the arm rests with suction off."""
        if self._next < len(self._actions):
            self._next += 1
            return self._actions[self._next - 1]
        rest = self._actions[-1].copy()
        if self._control == "joint_velocity":
            rest[:-1] = 0.0
        rest[-1] = -1.0
        return rest


class ClassPolicy:
    """A user's object with ``act(observation)``, and ``reset()`` or ``reset(instruction)`` if it has one."""

    def __init__(self, custom: Any) -> None:
        self._custom = custom

    def reset(self, start: EpisodeStart) -> None:
        """Call the object's ``reset``."""
        reset = getattr(self._custom, "reset", None)
        if reset is not None:
            arguments = (start.instruction,) if inspect.signature(reset).parameters else ()
            _call(reset, *arguments)

    def act(self, observation: Observation) -> Any:
        """The object's reply."""
        return _call(self._custom.act, observation)


def _call(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call foreign code. Raises PolicyFailure: it raised an exception; TimeoutError is passed on."""
    try:
        return function(*arguments)
    except TimeoutError:
        raise
    except Exception as error:
        raise PolicyFailure("policy_error", f"{type(error).__name__}: {error}") from error


class LerobotPolicy:
    """A checkpoint of LeRobot's policies."""

    def __init__(self, folder: Path) -> None:
        self._checkpoint = LerobotCheckpoint(folder)

    def reset(self, start: EpisodeStart) -> None:
        """Seed the policy and clear what it keeps between steps. Raises InputError: its actions are not the task's."""
        self._checkpoint.check_action(len(start.low))
        self._instruction = start.instruction
        _call(self._checkpoint.reset, start.seed)

    def act(self, observation: Observation) -> Any:
        """The next action (D,). Raises InputError: the observation has other shapes than the training's."""
        return _call(self._checkpoint.act, self._checkpoint.make_batch(observation, self._instruction))


def make_policy(name: str, layout: Layout, timeout: float) -> Policy:
    """The policy of a name; ``timeout`` (s) bounds each reply of a server.

    Raises:
        UnknownNameError: no policy has such a name.
        InputError: its class or server cannot be used.
    """
    if name == "oracle":
        return ExpertPolicy(layout.control)
    if name == "random":
        return RandomPolicy()
    kind, _, rest = name.partition(":")
    if kind == "openpi":
        return OpenpiPolicy(rest, timeout)
    if kind == "lerobot":
        return LerobotPolicy(Path(rest))
    if _CLASS.fullmatch(name):
        custom = _find_class(kind, rest)()
        return custom if isinstance(custom, ExpertPolicy) else ClassPolicy(custom)
    raise UnknownNameError("policy", name, NAMES)


def fit_layout_to_policy(name: str, layout: Layout) -> Layout:
    """The layout as the policy of a name takes it. Raises InputError: the layout lacks observations of the policy."""
    kind, _, rest = name.partition(":")
    return fit_layout(Path(rest), layout) if kind == "lerobot" else layout


def check_policy(name: str, layout: Layout, timeout: float) -> None:
    """Raise ``InputError`` unless a policy can be made, and its server be reached."""
    policy = make_policy(name, layout, timeout)
    if isinstance(policy, OpenpiPolicy):
        policy.connect_once()


class OpenpiPolicy:
    """A policy behind openpi's websocket server; a lost connection is made again at the next episode."""

    def __init__(self, address: str, timeout: float) -> None:
        self._client = OpenpiClient(address, timeout)

    def reset(self, start: EpisodeStart) -> None:
        """Connect, if there is no connection."""
        try:
            self._client.connect()
        except OSError as error:
            raise PolicyFailure("server_lost", str(error)) from error

    def connect_once(self) -> None:
        """Connect and close again. Raises InputError: no server of the protocol answers."""
        try:
            self._client.connect()
        except OSError as error:  # also TimeoutError
            raise InputError(f"no policy server answers: {error}", "start it, or mend the address") from error
        self._client.close()

    def act(self, observation: Observation) -> Mapping[str, Any]:
        """The server's reply."""
        try:
            return self._client.infer(observation)
        except TimeoutError as error:
            raise PolicyFailure("timeout", str(error)) from error
        except OSError as error:
            raise PolicyFailure("server_lost", str(error)) from error
        except ValueError as error:
            raise PolicyFailure("bad_reply", str(error)) from error


def _find_class(module: str, name: str) -> Callable[[], Any]:
    """The class ``name`` of a module. Raises InputError: it cannot be imported, or is none."""
    try:
        found = getattr(importlib.import_module(module), name)
    except ImportError as error:
        raise InputError(f"policy {module}:{name}: {error}", "run where the module can be imported") from error
    except AttributeError as error:
        raise InputError(f"module {module} has no {name}", "name a class of it") from error
    if not callable(getattr(found, "act", None)):
        raise InputError(f"{module}:{name} has no method act(observation)", "name a class that has one")
    return cast("Callable[[], Any]", found)
