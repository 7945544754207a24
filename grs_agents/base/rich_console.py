"""Rich's console, on which every text is visible."""

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from grs_agents.base.control_characters import escape_control_chars


class EscapingConsole(Console):
    """A console on which every text is visible, and none of it is markup."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does; lines of text stay whole, since a break in a command or a path would be copied with it.

        The terminal itself wraps a line that is too long for it.
        """
        if all(isinstance(item, Text) for item in objects):
            options.setdefault("soft_wrap", True)
        super().print(*objects, **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """The segments of ``renderable``; rich's control codes stay."""
        if isinstance(renderable, Text) and escape_control_chars(renderable.plain) != renderable.plain:
            # before it is wrapped, so that nothing is cut off
            renderable = Text(
                escape_control_chars(renderable.plain),
                renderable.style,
                justify=renderable.justify,
                overflow=renderable.overflow,
                no_wrap=renderable.no_wrap,
            )
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=escape_control_chars(segment.text))
