"""`rover plan try` for other processes: a JSON object from stdin, the report as JSON to stdout."""

import json
import sys
from base64 import b64decode

from executive.commands import PlanArgument, PlanDefinition
from executive.settings import SettingsError
from sim.trial.run import PlanRefusedError, Trial
from sim.trial.session import execute, usual_vary

NOT_USABLE = 2


def main() -> None:
    """Read the keys below from stdin; write the report of `rover plan try --json` to stdout.

    The exit status is that of `rover plan try`; a text on stderr explains status 2.
    """
    request = json.load(sys.stdin)
    plan = PlanDefinition(
        request["plan_id"],
        request["name"],
        request["format"],
        b64decode(request["content_base64"]),
        tuple(PlanArgument(each["name"], each["value"]) for each in request["arguments"]),
    )
    trial = Trial(
        plan=plan,
        asset=request["asset"],
        vary=usual_vary(None, ()),
        begin_utc_s=request["begin_utc_s"],
    )
    try:
        report = execute(trial, range(request["draws"]), 1, None, f"rover plan try {plan.name}")
    except (SettingsError, PlanRefusedError) as error:
        print(f"Error: {error}", file=sys.stderr)
        sys.exit(NOT_USABLE)
    print(json.dumps(report.document()))
    sys.exit(report.completed < report.draws)


if __name__ == "__main__":
    main()
