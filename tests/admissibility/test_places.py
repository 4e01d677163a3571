"""What is not finite at the start has a place in the file, by whatever it comes."""

from __future__ import annotations

import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.run.session import open_case

# Of each what is not finite, and the line of the file where it is written.
PLANE = """\
coordinates: {{x: {{}}, y: {{}}}}
definitions: {{d: '{definition}'}}
energy:
  kinetic: '{mass}*(x_dot^2 + y_dot^2)/2'
  potential: '{potential}'
forces:
  x: '{force}'
constraints:
  held: {{relation: 'y_dot = 0', limit: '{limit}'}}
  floor: {{relation: 'x >= 0', restitution: 0.5, friction: '{mu}', slip: y_dot}}
initial: {{x: 1, y: 0.5}}
simulation: {{duration: 1}}
"""
SOUND = {
    "definition": "x*y", "mass": "1", "potential": "9.81*x", "force": "d", "limit": "1",
    "mu": "0.3",
}  # fmt: skip
BAD = ["asin(3*x)", "sqrt(y - 2)", "log(-x)", "1/(x - 1)"]
CASES = [
    ({"definition": bad}, {2}) for bad in BAD
] + [({"force": bad}, {7}) for bad in BAD] + [
    ({"limit": bad}, {9}) for bad in BAD
] + [({"potential": bad}, {5}) for bad in BAD] + [
    ({"limit": "d", "definition": BAD[0]}, {2, 9}),
    ({"potential": BAD[0], "force": BAD[1]}, {5, 7}),
    ({"mass": "1e308*10"}, {4}),
    ({"mass": "1e200*1e200*x"}, {4}),
]  # fmt: skip


@pytest.mark.parametrize("file", ["model.yaml", "other/second.yaml"])
@pytest.mark.parametrize(("changed", "lines"), CASES)
def test_it_has_file_line_and_column(changed, lines, file):
    with pytest.raises(InputError) as raised:
        open_case(read(PLANE.format(**SOUND | changed), file))
    for problem in raised.value.problems:
        assert problem.code == "not-finite"
        assert problem.file == file
        assert problem.line in lines
        assert problem.column >= 1
