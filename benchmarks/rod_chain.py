"""Chains of rods in Cartesian coordinates: three for each rod, two constraints."""


def rod_chain(n, duration, output_step=0.01):
    """Return the model text of n rods, 1 m and 1 kg in all, released horizontally."""
    rods = range(1, n + 1)
    lines = [
        f"name: rods-{n}",
        f"parameters: {{m: {1 / n!r}, g: 9.81, l: {1 / n!r}}}",
        "coordinates:",
        *(f"  {c}{k}: {{}}" for k in rods for c in "xya"),
        "definitions:",
        *(
            f"  {c}_tip: {c}{n} + l/2*{f}(a{n})"
            for c, f in (("x", "cos"), ("y", "sin"))
        ),
        "energy:",
        '  kinetic: "m*('
        + " + ".join(f"x{k}_dot^2 + y{k}_dot^2 + l^2/12*a{k}_dot^2" for k in rods)
        + ')/2"',
        f'  potential: "m*g*({" + ".join(f"y{k}" for k in rods)})"',
        "constraints:",
        *_joints(n),
        "initial:",
    ]
    for k in rods:
        lines += [f"  x{k}: {k - 0.5}*l", f"  y{k}: 0", f"  a{k}: 0"]
    lines += [
        f"simulation: {{duration: {duration}, output_step: {output_step}}}",
        "output: {columns: [x_tip, y_tip]}",
    ]
    return "\n".join(lines) + "\n"


def _joints(n):
    """Return the constraints: each rod begins where the previous one ends."""
    for k in range(1, n + 1):
        for c, f in (("x", "cos"), ("y", "sin")):
            before = f"{c}{k - 1} + l/2*{f}(a{k - 1})" if k > 1 else "0"
            yield f"  {c}_joint{k}: {c}{k} - l/2*{f}(a{k}) = {before}"
