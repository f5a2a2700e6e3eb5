"""Plain data of shapes as JSON and YAML text, and back; a field given twice is refused."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Callable, Mapping
from typing import Any

from ..errors import InputError

__all__ = ["format_json", "format_yaml", "parse_json", "parse_yaml"]


def format_json(data: Mapping[str, Any]) -> str:
    """Return JSON with one shape a line."""
    head = json.dumps({key: value for key, value in data.items() if key != "shapes"}, indent=2)
    rows = ",\n".join(f"    {json.dumps(shape)}" for shape in data["shapes"])
    return f'{head[:-2]},\n  "shapes": [\n{rows}\n  ]\n}}\n'


def format_yaml(data: Mapping[str, Any]) -> str:
    """Return YAML with its fields in order."""
    import yaml

    return str(
        yaml.safe_dump(
            dict(data), sort_keys=False, allow_unicode=True, default_flow_style=None, width=1000
        )
    )


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(f"the field {reprlib.repr(key)} is given twice")
        found[key] = value
    return found


def parse_json(text: str) -> Any:
    """Return what a JSON text holds, or raise `InputError` in one line."""
    try:
        return json.loads(text, object_pairs_hook=_once)
    except InputError:
        raise
    except RecursionError:
        raise InputError("not JSON that can be read: it is nested too deeply") from None
    except ValueError as error:
        raise InputError(f"not JSON: {error}") from None


def parse_yaml(text: str) -> Any:
    """Return what a YAML text holds, or raise `InputError` in one line."""
    import yaml

    class Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
        def compose_node(self, parent: Any, index: Any) -> Any:
            # A few lines of references to references can stand for more than fits in memory.
            if self.check_event(yaml.AliasEvent):
                event = self.peek_event()
                raise InputError(
                    f"line {event.start_mark.line + 1} refers to '&{event.anchor[:40]}': write it "
                    "out, references are not read"
                )
            return super().compose_node(parent, index)

    def construct(loader: Any, node: Any) -> dict[str, Any]:
        return _once(
            [
                (loader.construct_object(key, deep=True), loader.construct_object(value, deep=True))
                for key, value in node.value
            ]
        )

    Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, construct)
    load: Callable[..., Any] = yaml.load
    try:
        return load(text, Loader=Loader)
    except InputError:
        raise
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(f"not YAML{where}: {problem}") from None
