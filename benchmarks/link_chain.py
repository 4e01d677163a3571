"""The text of a chain of point masses on massless links, in angles."""


def chain(n, duration):
    """Return the model text of n links of 1/n metres, released horizontally."""
    links = range(1, n + 1)
    lines = [
        f"name: chain-{n}",
        f"parameters: {{m: 1.0, g: 9.81, l: {1 / n!r}}}",
        "coordinates:",
        *(f"  a{k}: {{}}" for k in links),
        "definitions:",
        "  x1: l*sin(a1)",
        "  y1: -l*cos(a1)",
    ]
    for k in links[1:]:
        lines += [f"  x{k}: x{k - 1} + l*sin(a{k})", f"  y{k}: y{k - 1} - l*cos(a{k})"]
    kinetic = " + ".join(f"x{k}_dot^2 + y{k}_dot^2" for k in links)
    heights = " + ".join(f"y{k}" for k in links)
    lines += [
        "energy:",
        f'  kinetic: "m*({kinetic})/2"',
        f'  potential: "m*g*({heights})"',
        "initial:",
        *(f"  a{k}: pi/2" for k in links),
        f"simulation: {{duration: {duration}, output_step: 0.01}}",
        f"output: {{columns: [x{n}, y{n}]}}",
    ]
    return "\n".join(lines) + "\n"
