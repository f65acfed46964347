"""A law as one Python file that needs NumPy only."""

from __future__ import annotations

from ruptfx.app.export_law import TOLERANCE, ExportedLaw, Function, wrapped
from ruptfx.platform.codegen.tracing import numpy_literal, numpy_text, statements


def write(law: ExportedLaw) -> dict[str, str]:
    """Return the file."""
    head = law.head("#")
    fields = "\n".join(
        f"    {each.name}: float = {each.value!r}  # [{each.unit}] {each.description}" for each in law.parameters
    )
    text = f'''{head}#
# Numbers may be arrays of points. `python {law.kind}.py` compares with the numbers of ruptfx.
"""Friction law {law.kind}."""

import sys
from dataclasses import dataclass

import numpy as np


@dataclass
class Parameters:
    """Parameters of the law."""

{fields or "    pass"}

{"".join(_function(law, each) for each in law.functions)}
{_self_test(law)}'''
    return {f"{law.kind}.py": text}


def _function(law: ExportedLaw, function: Function) -> str:
    lines, results = statements(function.outputs, numpy_text, numpy_literal, law.names("p.{}", 's["{}"]'))
    arguments = ", ".join(["p", *(["s"] if function.reads_state else []), *function.inputs])
    returned = (
        "{" + ", ".join(f'"{name}": {text}' for name, text in results.items()) + "}"
        if function.returns_state else results["value"]
    )  # fmt: skip
    about = wrapped(f"Return the {function.description}.", 100, "    ").strip()
    body = "".join(f"    {name} = {text}\n" for name, text in lines)
    return f'\ndef {function.name}({arguments}):\n    """{about}"""\n{body}    return {returned}\n\n'


def _self_test(law: ExportedLaw) -> str:
    rows = ",\n".join(f"    ({dict(each.inputs)!r}, {dict(each.state)!r}, {each.expected!r})" for each in law.samples)
    names = [each for each in law.functions if each.name in law.samples[0].expected]
    calls = "\n".join(
        f"        results[\"{each.name}\"] = {each.name}(p, {'s, ' if each.reads_state else ''}"
        + ", ".join(f'x["{name}"]' for name in each.inputs) + ")"
        for each in names
    )  # fmt: skip
    return f'''
SAMPLES = [
{rows},
]


def self_test():
    """Return how many numbers differ from those of ruptfx."""
    failures, p, results = 0, Parameters(), {{}}
    for x, s, expected in SAMPLES:
{calls}
        for name, outputs in expected.items():
            result = results[name] if isinstance(results[name], dict) else {{"value": results[name]}}
            for key, value in outputs.items():
                if not abs(result[key] - value) <= {TOLERANCE!r} * abs(value):
                    failures += 1
                    print(f"{{name}} {{key}}: {{result[key]!r}}, expected {{value!r}}")
    return failures


if __name__ == "__main__":
    failed = self_test()
    print("{law.kind}:", f"{{failed}} numbers differ" if failed else "all numbers agree")
    sys.exit(failed > 0)
'''
