"""`rover whatif` for other processes: a JSON object from stdin, the answer as JSON to stdout."""

import json
import sys
from pathlib import Path

import click

from adapters.recording import RecordingError
from executive.settings import SettingsError, structure
from sim.fork.forkable import whatif
from sim.fork.model import Fidelity
from sim.fork.question import Question


def main() -> None:
    """Read the attributes of a `Question` from stdin; write `rover whatif --json` to stdout.

    The exit status is that of `rover whatif`; a text on stderr explains status 2.
    """
    try:
        question = structure(json.load(sys.stdin), Question, "question")
        answer = whatif(Path(question.recording), question.change(), question.at_s, question.seeds)
    except (RecordingError, SettingsError, click.UsageError) as error:
        print(f"Error: {error}", file=sys.stderr)
        sys.exit(2)
    print(json.dumps(answer.document()))
    sys.exit(answer.fidelity is Fidelity.DIFFERENT)


if __name__ == "__main__":
    main()
