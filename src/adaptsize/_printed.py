"""Objects that notebooks show as `print` does."""

from typing import Any


class Printed:
    """A base of classes whose text is worth more than their fields in one line."""

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """Show the text at the end of a cell."""
        printer.text("..." if cycle else str(self))
