"""How many time steps an environment may simulate: never a matter of the clock."""

from typing import Final

from grs_agents.sim.episode import SimulationBudgetError

DEFAULT_BUDGET: Final = 500_000


class Budget:
    """Simulated steps left to one environment."""

    def __init__(self, steps: int = DEFAULT_BUDGET) -> None:
        self.limit = self.left = steps

    def spend(self, steps: int) -> None:
        """Take ``steps``.

        Raises:
            SimulationBudgetError: there are not so many left.
        """
        self.left -= steps
        if self.left < 0:
            raise SimulationBudgetError(
                f"the environment used up its {self.limit} simulated steps", "reset less often or do less in a step"
            )
