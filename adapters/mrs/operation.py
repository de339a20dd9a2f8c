"""How a sub-command of `rover command` is typed: numbers below 0, options where they belong."""

from difflib import get_close_matches

import click


class Operation(click.Command):
    """A sub-command whose arguments may begin with a minus, and that explains a wrong option."""

    ignore_unknown_options = True

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read what was typed.

        Raises:
            click.UsageError: an option is none, or one of `rover command` itself.
        """
        own = _names(self.get_params(ctx))
        above = set() if ctx.parent is None else _names(ctx.parent.command.params)
        for word in args:
            name = word.partition("=")[0]
            if word == "--":
                break
            if not word.startswith("--") or name in own:
                continue
            if name in above:
                raise click.UsageError(
                    f"{name} is an option of `rover command`: it stands before the operation,"
                    f" `rover command {word} {self.name} ...`",
                    ctx,
                )
            raise click.NoSuchOption(name, possibilities=get_close_matches(name, own), ctx=ctx)
        return super().parse_args(ctx, args)


def _names(parameters: list[click.Parameter]) -> set[str]:
    return {name for each in parameters if isinstance(each, click.Option) for name in each.opts}
