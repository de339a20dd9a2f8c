"""YAML files from strangers: whatever is in them, either data comes out or one error."""

from pathlib import Path
from typing import Any, Final

import yaml

_MERGE: Final = "tag:yaml.org,2002:merge"


class YamlError(Exception):
    """A file holds no YAML that can be used; the text says why, without the file's name."""


class _Loader(yaml.CSafeLoader):
    """Refuses a key that is said twice, where YAML would forget the first."""


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen = set()
    for key, _ in node.value:
        if key.tag == _MERGE:
            continue
        name = loader.construct_object(key, deep=True)
        if name in seen:
            raise yaml.constructor.ConstructorError(
                None, None, f"key {name!r} is said twice", key.start_mark
            )
        seen.add(name)
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def load_yaml(path: Path) -> object:
    """Return what a YAML file holds.

    Raises:
        YamlError: the file cannot be read, or is not YAML.
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except OSError as error:
        raise YamlError(f"cannot be read ({error.strerror})") from error
    except RecursionError as error:
        raise YamlError("is nested too deeply") from error
    except (yaml.YAMLError, ValueError, TypeError) as error:  # a date or key may be none
        raise YamlError(f"is not YAML ({' '.join(str(error).split())})") from error
