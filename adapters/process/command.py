"""`process` decorates the `main` of a server process: options, data folder, signals, exit status.

Exit status: 0 ended by a signal, 1 cannot start, continue or write its output, 2 invalid command
line or settings file, 141 the output is closed. Standard output may be a closed pipe, a full disk
or a terminal without UTF-8. The log on standard error has one line per event, regardless of the
texts' content.
"""

import asyncio
import codecs
import errno
import io
import logging
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import current_thread, main_thread
from types import FrameType
from typing import Any, Final, TypeVar

import click

from adapters.process.start import missing_package

SWITCH_S: Final = 0.001
"""Python's switch interval: the maximum wait of a thread for one that computes. A stop passes three
threads; the usual 5 ms dominated its latency (p99 13.8 ms, 7.4 ms with 1 ms, nothing queued)."""
ROS_ARGS: Final = "--ros-args"
PORT_NUMBER: Final = click.IntRange(0, 65535)
"""A TCP or UDP port; 0 selects a free one."""
EXISTING_FILE: Final = click.Path(exists=True, dir_okay=False, path_type=Path)
_Decorated = TypeVar("_Decorated", bound=Callable[..., Any])
_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


class StartError(Exception):
    """A process cannot start or continue; the text gives the cause and the remedy."""


class ProcessCommand(click.Command):
    """The command line of a process that serves until a signal.

    Its callback raises StartError if it cannot start, SettingsError if a setting is invalid.
    """

    def main(self, *arguments: Any, **options: Any) -> Any:
        """Run it under its own name, also as `python -m`."""
        guard_output()
        return super().main(*arguments, **{"prog_name": self.name, **options})

    def invoke(self, ctx: click.Context) -> Any:
        """Run the process; a start error is shown in one line."""
        from executive.settings import SettingsError

        sys.setswitchinterval(SWITCH_S)
        try:
            return super().invoke(ctx)
        except SettingsError as error:
            raise click.UsageError(str(error), ctx) from error
        except (StartError, ImportError) as error:
            text = str(error) if isinstance(error, StartError) else missing_package(error)
            if text is None:
                raise
            raise click.ClickException(text) from error


class RosProcessCommand(ProcessCommand):
    """A ROS process: `ctx.obj` has the arguments between `--ros-args` and `--`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments that are not for ROS."""
        own, ros = split_ros_arguments(args)
        ctx.obj = tuple(ros)
        return super().parse_args(ctx, own)


def process(name: str, *, ros: bool = True) -> Callable[[Callable[..., None]], ProcessCommand]:
    """Decorate a function as the command line of a process; with `ros`, of a ROS process.

    For example; the first argument has the arguments after `--ros-args`:

        @process("rover-relay")
        @click.option("--asset", default="jackal", show_default=True)
        @data_option("the bundles")
        @log_level_option
        @click.pass_obj
        def main(ros_arguments, asset, data): ...
    """
    settings = {"help_option_names": ["-h", "--help"], "max_content_width": 100}
    cls = RosProcessCommand if ros else ProcessCommand
    return click.command(name, cls=cls, context_settings=settings)


def split_ros_arguments(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return a command line's own arguments, and those between `--ros-args` and `--`."""
    own: list[str] = []
    ros: list[str] = []
    into = own
    for argument in arguments:
        if argument == ROS_ARGS:
            into = ros
        elif argument == "--" and into is ros:
            into = own
        else:
            into.append(argument)
    return own, ros


def _assets(_: click.Context, __: click.Parameter, begun: str) -> list[str]:
    """Return the names of assets for shell completion."""
    from executive.settings import config_folder, names_in

    robots = [f"robots/{name}" for name in names_in(config_folder() / "robots")]
    return [name for name in names_in(config_folder()) + robots if name.startswith(begun)]


def asset_option(
    help: str = "Asset name, or its YAML file.", default: str = "jackal"
) -> Callable[[_Decorated], _Decorated]:
    """Return the option `--asset`, with shell completion of names."""
    return click.option(
        "--asset", default=default, show_default=True, shell_complete=_assets, help=help
    )


def data_option(contents: str, name: str = "ASSET") -> Callable[[_Decorated], _Decorated]:
    """Return the option `--data`, the folder of persistent data; None is `default_folder(name)`."""
    return click.option(
        "--data",
        type=click.Path(path_type=Path),
        envvar="ROVER_DATA",
        help=f"Folder of {contents}.  [default: $ROVER_DATA, or ~/.local/share/rover/{name}]",
    )


def _metrics_address(
    _: click.Context, __: click.Parameter, text: str | None
) -> tuple[str, int] | None:
    *host, port = (text or "0").rsplit(":", 1)
    if not (port.isdecimal() and int(port) <= 65535):
        raise click.BadParameter(f"{text!r} is not PORT or HOST:PORT, such as 9464")
    return None if text is None else ("".join(host).strip("[]") or "127.0.0.1", int(port))


metrics_option = click.option(
    "--metrics",
    callback=_metrics_address,
    metavar="[HOST:]PORT",
    help="Serve metrics for Prometheus at http://HOST:PORT/metrics, without access control;"
    " HOST is 127.0.0.1 by default, PORT 0 takes a free one.  [default: not served]",
)
"""`--metrics`, an address."""


def _log_level(_: click.Context, __: click.Parameter, level: str) -> None:
    log_to_stderr(level)


log_level_option = click.option(
    "--log-level",
    type=click.Choice(["debug", "info", "warning", "error"]),
    default="info",
    show_default=True,
    expose_value=False,
    callback=_log_level,
    help="Lowest level that is logged, on standard error.",
)
"""`--log-level`, which takes effect at once."""


class Termination:
    """Whether the termination of this process is requested.

    After the first signal all further ones are ignored to the end of the process: a second one
    must not interrupt the stop of the rover. Only for the main thread, which must poll it.
    """

    def __init__(self) -> None:
        self.requested = False
        for number in _SIGNALS:
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.requested = True
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def termination_event() -> asyncio.Event:
    """Return an event that SIGINT and SIGTERM set from now on, on the running loop."""
    requested, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in _SIGNALS:
        loop.add_signal_handler(number, requested.set)
    return requested


def default_folder(name: str) -> Path:
    """Return the default folder of a process's files."""
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "rover" / name


@contextmanager
def exclusive(folder: Path, lock: str) -> Iterator[None]:
    """Create a folder and lock it; the kernel releases the lock however this process ends.

    The file `lock` in it has this process's id while it runs, and is empty after it (unless
    killed).

    Raises:
        StartError: another process holds the lock, or the folder cannot be created.
    """
    import fcntl  # Windows has none, and the ground's commands import this package

    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = (folder / lock).open("a+", encoding="utf-8")
    except OSError as error:
        why = f"{folder} cannot be used: {error.strerror}"
        raise StartError(f"{why}; --data names another folder") from error
    with held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            held.seek(0)
            raise StartError(
                f"another process ({held.read().strip() or 'unknown'}) uses {folder}: stop it,"
                " or give this one a folder of its own with --data"
            ) from error
        try:
            os.ftruncate(held.fileno(), 0)
            os.write(held.fileno(), f"{os.getpid()}\n".encode())
        except OSError as error:
            raise StartError(
                f"{folder} cannot be written: {error.strerror}; free some space, or name another"
                " folder with --data"
            ) from error
        try:
            yield
        finally:
            with suppress(OSError):
                os.ftruncate(held.fileno(), 0)


UNREAD: Final = 141
"""Exit status if the output is closed: the value that a shell reports for SIGPIPE."""

_PLAIN: Final = "rover.plain"
_SPELLED: Final = str.maketrans(
    "×−–²µ·“”→⇉◆◇▸●✓✕↓↑←│├└─", "x--2u.''>=#o>*+xv^<||`-"
) | str.maketrans({"±": "+-", "…": "...", "°": "deg"})
"""ASCII for the product's symbols on a terminal without UTF-8; other letters become `?`."""


def guard_output() -> None:
    """End the program with an exit status, not a traceback, if standard output fails.

    Every writer, such as click or rich, gets SystemExit if the output cannot be written.
    Symbols that the terminal's encoding lacks are replaced by ASCII.
    """
    stdout = sys.stdout
    if stdout is None:  # closed by the parent process
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    elif stdout is sys.__stdout__ and isinstance(stdout, io.TextIOWrapper):
        raw = io.BufferedWriter(_Output(stdout.fileno(), "w", closefd=False))
        buffered = stdout.line_buffering or stdout.write_through
        sys.stdout = io.TextIOWrapper(raw, stdout.encoding, _PLAIN, line_buffering=buffered)


class _Output(io.FileIO):
    """Standard output; fails once, and in the main thread, so that its exit ends the program."""

    _lost = False

    def write(self, octets: Any, /) -> int:
        """Write octets, or raise SystemExit: with `UNREAD`, or a text for standard error."""
        if self._lost:
            return memoryview(octets).nbytes
        try:
            return super().write(octets)
        except OSError as error:
            self._lost = current_thread() is main_thread()
            logging.getLogger("asyncio").disabled = True  # an exit in a task is no lost exception
            if error.errno == errno.EPIPE:
                raise SystemExit(UNREAD) from None
            raise SystemExit(f"Error: output cannot be written: {error.strerror}") from None


def _spell(error: UnicodeError) -> tuple[str, int]:
    """Return ASCII for symbols that an encoding lacks; an error handler of `codecs`."""
    assert isinstance(error, UnicodeEncodeError)
    spelled = error.object[error.start : error.end].translate(_SPELLED)
    return spelled.encode("ascii", "replace").decode(), error.end


codecs.register_error(_PLAIN, _spell)


class OneLineFormatter(logging.Formatter):
    """UTC, level and text on one line; control characters and line ends are escaped.

    Texts also contain input of peers: none may imitate a line of the log, or control a terminal.
    The lines of a traceback follow, each indented.
    """

    converter = staticmethod(time.gmtime)
    default_time_format = "%Y-%m-%dT%H:%M:%S"
    default_msec_format = "%s.%03dZ"

    def __init__(self) -> None:
        from executive.values.reports import printable  # `rover --help` imports no package

        self._printable = printable
        super().__init__("%(asctime)s %(levelname)-7s %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """Return the line of a record."""
        record.message = self._printable(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: object) -> str:  # noqa: N802 - logging's name
        """Return the lines of a traceback."""
        text = super().formatException(ei)  # type: ignore[arg-type]
        return "\n".join(f"  {self._printable(line)}" for line in text.split("\n"))


def log_to_stderr(level: str) -> None:
    """Log to standard error from a level upwards."""
    handler = logging.StreamHandler()
    handler.setFormatter(OneLineFormatter())
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)
    logging.getLogger("transitions").setLevel(logging.WARNING)  # logs every stage of a life cycle
