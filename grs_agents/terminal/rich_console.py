"""Rich's console, on which every text is visible."""

from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from grs_agents.terminal.control_characters import escape_control_chars


class EscapingConsole(Console):
    """A console on which every text is visible, and none of it is markup."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """The segments of ``renderable``, as rich asks for them; its own control codes stay."""
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
