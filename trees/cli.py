"""The command `rover tree`: draws the behaviour tree of an asset, without a running executive."""

import click


@click.command()
@click.option(
    "--format",
    "form",
    type=click.Choice(["unicode", "mermaid", "svg"]),
    default="unicode",
    show_default=True,
    help="Output format.",
)
@click.option("--asset", default="jackal", show_default=True, help="Asset name, or its YAML file.")
def tree(form: str, asset: str) -> None:
    """Print the behaviour tree of an asset.

    \b
    Examples:
      rover tree
      rover tree --format svg > tree.svg
    """
    from executive.settings import SettingsError, load_settings
    from trees.rover import preview
    from trees.snapshot import as_mermaid, as_svg, as_text

    try:
        nodes = preview(load_settings(asset))
    except SettingsError as error:
        raise click.UsageError(str(error)) from error
    match form:
        case "mermaid":
            click.echo(as_mermaid(nodes), nl=False)
        case "svg":
            click.echo(as_svg(nodes), nl=False)
        case _:
            click.echo(as_text(nodes))
