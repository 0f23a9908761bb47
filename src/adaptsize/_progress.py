"""Progress of long computations, by a callback or as a bar on the terminal."""

from collections.abc import Iterator
from contextlib import contextmanager

from adaptsize._checks import describe
from adaptsize.typing import ProgressCallback


@contextmanager
def reporting(progress: ProgressCallback | bool | None) -> Iterator[ProgressCallback]:
    """Yield a callback ``(text, share)``.  ``True`` gives a rich bar on standard error.

    The bar is not shown when standard error is not a terminal.  An exception in the
    callback, including KeyboardInterrupt, propagates to the caller and stops the work.
    """
    if progress is None or progress is False:
        yield _ignore
    elif progress is True:
        with _rich_bar() as callback:
            yield callback
    elif not callable(progress):
        raise ValueError(f"progress must be callable or True or False, got {describe(progress)}")
    else:
        yield progress


def _ignore(text: str, share: float | None) -> None:
    """Report nothing."""


@contextmanager
def _rich_bar() -> Iterator[ProgressCallback]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        tasks: dict[str, int] = {}

        def report(text: str, share: float | None) -> None:
            if text not in tasks:
                for done in tasks.values():
                    bar.update(done, visible=False)  # type: ignore[arg-type]
                tasks[text] = int(bar.add_task(text, total=None if share is None else 1.0))
            if share is not None:
                bar.update(tasks[text], total=1.0, completed=share)  # type: ignore[arg-type]

        yield report
