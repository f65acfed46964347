"""A law as C11: a header, its functions, and a program that tests them."""

from __future__ import annotations

from ruptfx.app.export_law import TOLERANCE, UNITS, ExportedLaw, Function, Sample, wrapped
from ruptfx.platform.codegen.tracing import to_c


def write(law: ExportedLaw) -> dict[str, str]:
    """Return the header, the functions and the test."""
    kind, head = law.kind, law.head(" *")
    build = (
        f" *\n * cc {kind}.c {kind}_test.c -lm -o {kind}_test && ./{kind}_test   compares with the numbers of ruptfx.\n"
    )
    head = f"/*\n{head}{build} */\n"
    fields = "".join(
        wrapped(f"/* [{each.unit}] {each.description} */", 100, "    ") + f"\n    double {each.name};\n"
        for each in law.parameters
    )
    states = "".join(f"    double {name}; /* [{unit}] */\n" for name, unit in law.states.items())
    values = ", ".join(f".{each.name} = {each.value!r}" for each in law.parameters)
    declared = "".join(f"/* {each.name}: {each.description} */\n{signature(law, each)};\n\n" for each in law.functions)
    header = f"""{head}#ifndef {kind.upper()}_H
#define {kind.upper()}_H

#ifdef __cplusplus
extern "C" {{
#endif

typedef struct {{
{fields or "    double unused;\n"}}} {kind}_parameters;

typedef struct {{
{states or "    double unused;\n"}}} {kind}_state;

/* Parameters with which the law was written. */
extern const {kind}_parameters {kind}_default;

{declared}#ifdef __cplusplus
}}
#endif
#endif
"""
    body = f"""{head}#include <math.h>

#include "{kind}.h"

const {kind}_parameters {kind}_default = {{{values or "0"}}};

{"".join(_function(law, each) for each in law.functions)}"""
    return {f"{kind}.h": header, f"{kind}.c": body, f"{kind}_test.c": _test(law)}


def signature(law: ExportedLaw, function: Function) -> str:
    """Return the declaration of a function."""
    numbers = [f"double {name} /* {UNITS[name]} */" for name in function.inputs]
    state = [f"const {law.kind}_state *s"] if function.reads_state else []
    result = [f"{law.kind}_state *result"] if function.returns_state else []
    arguments = ", ".join([f"const {law.kind}_parameters *p", *state, *numbers, *result])
    returned = "void" if function.returns_state else "double"
    return wrapped(f"{returned} {law.kind}_{function.name}({arguments})", 110, "")


def _function(law: ExportedLaw, function: Function) -> str:
    # The outputs are written last, so that the result may be the state that is read.
    outputs = {f"double new_{name}" if function.returns_state else "const double value": each
               for name, each in function.outputs.items()}  # fmt: skip
    lines = to_c(outputs, names=law.names("p->{}", "s->{}")).split("\n")
    if function.returns_state:
        lines += [f"result->{name} = new_{name};" for name in function.outputs]
    else:
        lines.append("return value;")
    arguments = ("p", *(["s"] if function.reads_state else []), *function.inputs)
    silent = "".join(f"    (void){name};\n" for name in arguments)
    body = "".join(f"    {line}\n" for line in lines)
    return f"{signature(law, function)} {{\n{silent}{body}}}\n\n"


def _test(law: ExportedLaw) -> str:
    kind = law.kind
    blocks = "".join(_block(law, each) for each in law.samples)
    return f"""/* Compares {kind} with the numbers of ruptfx. */
#include <math.h>
#include <stdio.h>

#include "{kind}.h"

static int failures;

static void compare(const char *name, double value, double expected) {{
    if (!(fabs(value - expected) <= {TOLERANCE!r} * fabs(expected))) {{
        ++failures;
        printf("%s: %.17g, expected %.17g\\n", name, value, expected);
    }}
}}

int main(void) {{
    const {kind}_parameters *p = &{kind}_default;
    {kind}_state s, result;
    (void)s, (void)result;
{blocks}    printf("{kind}: %d numbers differ\\n", failures);
    return failures > 0;
}}
"""


def _block(law: ExportedLaw, sample: Sample) -> str:
    lines = [f"s.{name} = {value!r};" for name, value in sample.state.items()]
    for function in law.functions:
        if function.name not in sample.expected:
            continue
        arguments = ["p", *(["&s"] if function.reads_state else [])]
        arguments += [repr(sample.inputs[name]) for name in function.inputs]
        call, expected = f"{law.kind}_{function.name}", sample.expected[function.name]
        if not function.returns_state:
            lines.append(f'compare("{function.name}", {call}({", ".join(arguments)}), {expected["value"]!r});')
            continue
        lines.append(f"{call}({', '.join([*arguments, '&result'])});")
        lines += [f'compare("{function.name} {name}", result.{name}, {value!r});' for name, value in expected.items()]
    return "".join(f"    {line}\n" for line in lines)
