"""The catalogue of requests, and what is known of each.

Whether one may enter, and the life of a command, stand beside this face in modules of their own,
which need the settings: `intake`, `lifecycle` and `actions`.
"""

# Without a list of its own (and so without `__all__`): a request stands in the catalogue alone.
from executive.commands.catalogue import *  # noqa: F403
from executive.commands.declaration import (
    Argument as Argument,
)
from executive.commands.declaration import (
    Declaration as Declaration,
)
from executive.commands.declaration import (
    Family as Family,
)
from executive.commands.declaration import (
    arguments_of as arguments_of,
)
from executive.commands.declaration import (
    declaration_of as declaration_of,
)
from executive.commands.declaration import (
    declared as declared,
)
from executive.commands.modes import Mode as Mode
