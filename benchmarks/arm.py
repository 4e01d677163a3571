"""The text of an arm of seven joints, written out."""


def arm(duration):
    """Return the model text of an arm whose joints turn about z and y alternately.

    Each link leads along z by l and along x by d, in the axes of its joint, to a mass.
    """
    joints = range(1, 8)
    lines = [
        "name: arm",
        "parameters: {g: 9.81, m: 2.0, l: 0.35, d: 0.05, J: 0.02}",
        f"coordinates: {{{', '.join(f'q{k}: {{}}' for k in joints)}}}",
        "definitions:",
    ]
    columns = [("1", "0", "0"), ("0", "1", "0"), ("0", "0", "1")]
    place = ("0", "0", "0")
    for k in joints:
        axis = 2 if k % 2 else 1
        a, b = (axis + 1) % 3, (axis + 2) % 3
        turned = {
            a: [
                _sum(f"cos(q{k})", x, f"sin(q{k})", y) for x, y in _pairs(columns, a, b)
            ],
            b: [
                _sum(f"cos(q{k})", y, f"-sin(q{k})", x)
                for x, y in _pairs(columns, a, b)
            ],
        }
        for j, entries in turned.items():
            names = [f"r{k}_{i}{j}" for i in range(3)]
            lines += [f"  {n}: {e}" for n, e in zip(names, entries, strict=True)]
            columns[j] = tuple(names)
        names = [f"{x}{k}" for x in "xyz"]
        lines += [
            f"  {n}: {_sum('1', p, 'l', z)} + {_sum('d', x)}"
            for n, p, z, x in zip(names, place, columns[2], columns[0], strict=True)
        ]
        place = tuple(names)
    squares = " + ".join(f"{x}{k}_dot^2" for k in joints for x in "xyz")
    turns = " + ".join(f"q{k}_dot^2" for k in joints)
    lines += [
        "energy:",
        f"  kinetic: m*({squares})/2 + J*({turns})/2",
        f"  potential: m*g*({' + '.join(f'z{k}' for k in joints)})",
        "initial:",
        *(f"  q{k}: {0.3 + 0.1 * k:.1f}" for k in joints),
        *(f"  q{k}_dot: {0.1 * k:.1f}" for k in joints),
        f"simulation: {{duration: {duration}, output_step: 0.01}}",
    ]
    return "\n".join(lines) + "\n"


def _pairs(columns, a, b):
    return zip(columns[a], columns[b], strict=True)


def _sum(*factors):
    """Write the sum of products of two factors each; a factor 0 omits a product."""
    terms = [
        f"{x}*{y}"
        for x, y in zip(factors[::2], factors[1::2], strict=True)
        if "0" not in (x, y)
    ]
    return " + ".join(terms) or "0"
