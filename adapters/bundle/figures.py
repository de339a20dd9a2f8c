"""Checks the figures of settings, so that no link meets one that makes no sense."""


def require_within(settings: object, **bounds: tuple[float, float]) -> None:
    """Do nothing where figures of a settings dataclass are within bounds, or None.

    Args:
        settings: the dataclass.
        **bounds: by the names of its fields, the least and the most that makes sense.

    Raises:
        ValueError: one is not.
    """
    for name, (least, most) in bounds.items():
        figure = getattr(settings, name)
        if figure is not None and not least <= figure <= most:
            raise ValueError(f"{name} must be {least:,} to {most:,}, not {figure}")
