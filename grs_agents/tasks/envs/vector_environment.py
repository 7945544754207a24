"""Vector environments: several environments in each of several processes, with observations in shared memory."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from typing import Any, Final, cast

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv, utils
from gymnasium.vector.utils import batch_space, read_from_shared_memory, write_to_shared_memory

from grs_agents.base.errors import GrsError, InputError
from grs_agents.tasks.envs.gym_environment import GrsEnv, Observation

_ERRORS: Final = (
    *(GrsError, gymnasium.error.Error, ArithmeticError, AttributeError, LookupError, OSError, RuntimeError),
    *(TypeError, ValueError),
)
"""Errors of an environment, which the parent raises in place of the process."""
_METADATA: Final[dict[str, Any]] = {**GrsEnv.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}
Step = tuple[Observation, npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]


class GrsVectorEnv(VectorEnv[Any, Any, Any]):
    """Environments ``GRS-v0`` side by side. Each process has several: a message to it costs half a step.

    Args:
        num_envs: number of environments.
        workers: processes; None for the number of cores.
        context: start method of the processes (``fork``, ``forkserver``, ``spawn``); None for the platform's.
        arguments: of ``GrsEnv``, for all.

    An environment that has ended begins a new episode at the next step, as gymnasium's ``AutoresetMode.NEXT_STEP``.

    Raises ``InputError`` for numbers below 1, ``GrsError`` where a process was killed, and the errors of ``GrsEnv``.
    """

    metadata = _METADATA

    def __init__(
        self, num_envs: int = 1, workers: int | None = None, context: str | None = None, **arguments: Any
    ) -> None:
        count = min(num_envs, workers if workers is not None else os.cpu_count() or 1)
        if count < 1:
            raise InputError(f"{num_envs} environments in {workers} processes", "give at least 1 of each")
        single = GrsEnv(**arguments)
        self.num_envs, self.render_mode = num_envs, single.render_mode
        self.single_observation_space, self.single_action_space = single.observation_space, single.action_space
        self.observation_space = batch_space(single.observation_space, num_envs)
        self.action_space = batch_space(single.action_space, num_envs)
        start: Any = multiprocessing.get_context(context)
        self._shared = _Shared(single, num_envs, start)
        self._views = self._shared.open()
        self._parts: list[list[int]] = [part.tolist() for part in np.array_split(np.arange(num_envs), count)]
        self._pipes: list[Any] = []
        self.processes: list[Any] = []
        for numbers in self._parts:
            pipe, end = start.Pipe()
            process = start.Process(target=_serve, args=(end, pipe, numbers, self._shared, arguments), daemon=True)
            process.start()
            end.close()
            self._pipes.append(pipe)
            self.processes.append(process)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin episodes, with ``seed``, ``seed + 1``, ... or a seed each; of ``options["reset_mask"]`` (num_envs,) if
        it is given. Other options and errors are those of ``GrsEnv.reset``."""
        rest = dict(options or {})
        mask = rest.pop("reset_mask", np.ones(self.num_envs, dtype=bool))
        seeds = [seed + number for number in range(self.num_envs)] if isinstance(seed, int) else seed
        seeds = [None] * self.num_envs if seeds is None else list(seeds)
        if len(seeds) != self.num_envs or len(mask) != self.num_envs:
            message = f"{len(seeds)} seeds and a mask of {len(mask)} for {self.num_envs} environments"
            raise InputError(message, "give one for each environment")
        wanted = [{number: seeds[number] for number in numbers if mask[number]} for numbers in self._parts]
        infos = self._ask([("reset", (part, rest)) for part in wanted])
        return self._copy_observations(), self._merge(infos)

    def step(self, actions: Any) -> Step:
        """Act in all environments; actions (num_envs, D)."""
        self._views.actions[:] = actions
        infos = self._ask([("step", ())] * len(self._pipes))
        views = self._views
        flags = views.terminated.copy(), views.truncated.copy()
        return self._copy_observations(), views.rewards.copy(), *flags, self._merge(infos)

    def call(self, name: str) -> tuple[Any, ...]:
        """An attribute of each environment, or the result of a method without arguments."""
        return tuple(self._ask([("call", (name,))] * len(self._pipes)))

    def render(self) -> tuple[Any, ...] | None:
        """Pictures (480, 640, 3) of each environment in ``render_mode`` ``rgb_array``, else None."""
        return None if self.render_mode is None else self.call("render")

    def close_extras(self, **kwargs: Any) -> None:
        """End the processes."""
        for pipe in self._pipes:
            pipe.close()  # which ends the process, and, as forks share pipes, those before it
        for process in self.processes:
            process.join()

    def _ask(self, requests: Sequence[tuple[str, tuple[Any, ...]]]) -> list[Any]:
        """Replies of each environment, in their order; the first error is raised when all have replied."""
        replies: list[Any] = []
        try:
            for pipe, request in zip(self._pipes, requests, strict=True):
                pipe.send(request)
            for pipe in self._pipes:
                replies.append(pipe.recv())
        except (EOFError, OSError) as error:
            raise GrsError("a process of the environments was killed", "use fewer workers or environments") from error
        for reply in replies:
            if isinstance(reply, Exception):
                raise reply
        return [item for reply in replies for item in reply]

    def _merge(self, infos: Sequence[tuple[int, dict[str, Any]]]) -> dict[str, Any]:
        merged: dict[str, Any] = {}
        for number, info in infos:
            merged = self._add_info(merged, info, number)
        return merged

    def _copy_observations(self) -> Observation:
        return {name: values.copy() for name, values in self._views.observations.items()}


class _Views:
    """Arrays in shared memory, a row for each environment."""

    observations: Observation
    actions: npt.NDArray[np.float32]
    rewards: npt.NDArray[np.float64]
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]


class _Shared:
    """Shared memory of observations, actions, rewards and flags."""

    def __init__(self, single: GrsEnv, count: int, start: Any) -> None:
        self.space, self.count = single.observation_space, count
        self.observations: Any = cast(Any, utils).create_shared_memory(self.space, count, start)
        self._size = int(np.prod(single.action_space.shape or ()))
        self._actions = start.RawArray("f", count * self._size)
        self._rewards = start.RawArray("d", count)
        self._terminated, self._truncated = start.RawArray("b", count), start.RawArray("b", count)

    def open(self) -> _Views:
        """Views of it in this process."""
        views, observations = _Views(), read_from_shared_memory(self.space, self.observations, self.count)
        views.observations = dict(observations)
        views.actions = np.frombuffer(self._actions, dtype=np.float32).reshape(self.count, self._size)
        views.rewards = np.frombuffer(self._rewards, dtype=np.float64)
        views.terminated, views.truncated = (
            np.frombuffer(flags, dtype=np.bool_) for flags in (self._terminated, self._truncated)
        )
        return views


def _serve(pipe: Any, end: Any, numbers: list[int], shared: _Shared, arguments: dict[str, Any]) -> None:
    """Reply to requests until the parent closes its ``end`` of the pipe, of which a fork has a copy."""
    end.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is interrupted, and closes its end
    envs, views = {number: GrsEnv(**arguments) for number in numbers}, shared.open()

    def reset(seeds: dict[int, int | None], options: dict[str, Any]) -> list[tuple[int, dict[str, Any]]]:
        infos: list[tuple[int, dict[str, Any]]] = []
        for number, seed in seeds.items():
            observation, info = envs[number].reset(seed=seed, options=options)
            write_to_shared_memory(shared.space, number, observation, shared.observations)
            views.rewards[number], views.terminated[number], views.truncated[number] = 0.0, False, False
            infos.append((number, info))
        return infos

    def step() -> list[tuple[int, dict[str, Any]]]:
        infos: list[tuple[int, dict[str, Any]]] = []
        for number, env in envs.items():
            if views.terminated[number] or views.truncated[number]:
                infos += reset({number: None}, {})
                continue
            observation, *outcome, info = env.step(views.actions[number])
            write_to_shared_memory(shared.space, number, observation, shared.observations)
            views.rewards[number], views.terminated[number], views.truncated[number] = outcome
            infos.append((number, info))
        return infos

    def call(name: str) -> list[Any]:
        values = [getattr(env, name) for env in envs.values()]
        return [value() if callable(value) else value for value in values]

    requests: dict[str, Callable[..., list[Any]]] = {"reset": reset, "step": step, "call": call}
    while True:
        try:
            name, values = pipe.recv()
        except EOFError:
            break
        try:
            pipe.send(requests[name](*values))
        except _ERRORS as error:
            pipe.send(error)
    for env in envs.values():
        env.close()
