"""`request_to_resume` chooses the request of `rover resume` by the state of the rover."""

import click

from adapters.mal import MalError
from adapters.mrs.cli.status_command import suspended_plans
from adapters.mrs.cli.terminal import echo_line
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AssetMode
from executive.commands import Request, Resume, ResumePlan


async def request_to_resume(client: MrsClient) -> Request:
    """Return `resume`, or `resumePlan` of the suspended plan if nothing else stops the rover.

    Prints the choice. An orbiter, which does not know the mode, gets `resume`.

    Raises:
        click.ClickException: nothing is to be resumed, or one of several plans.
    """
    try:
        asset, mode = (await client.get_asset()).asset, (await client.get_status()).mode
        latched = any(each.onResume for each in (await client.get_faults()).active)
    except MalError:
        return Resume()
    plans = [each.plan_id for each in await suspended_plans(client, mode)]
    if mode in {AssetMode.STOPPED, AssetMode.SAFE} or latched:
        echo_line(f"{asset} is {mode.name}: resume releases it", err=True)
        for plan in plans:
            echo_line(f"plan {plan} is suspended: `rover resume` again resumes it", err=True)
        return Resume()
    if mode is not AssetMode.PAUSED:
        raise click.ClickException(f"{asset} is {mode.name}: there is nothing to resume")
    if len(plans) > 1:
        choices = " or ".join(f"`rover plan resume {plan}`" for plan in plans)
        raise click.ClickException(f"several plans are suspended: {choices}")
    if not plans:
        return Resume()
    echo_line(f"{asset} is PAUSED: resumes plan {plans[0]}", err=True)
    return ResumePlan(plans[0])
