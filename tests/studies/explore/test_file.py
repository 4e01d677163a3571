"""The page in one file: refusals, size, and in a browser the motions of its run."""

import base64
import hashlib
import json
import re
import zlib

import numpy as np
import pytest

import lagsim
from lagsim.cli._faults import error_text
from lagsim.errors import LagsimError
from lagsim.language.functions import FUNCTIONS, OPERATIONS
from lagsim.outputs.animation import stage
from lagsim.studies.explore.explorer import Explorer
from lagsim.studies.explore.file import page_in_a_file
from tests.outputs.browser import RefusedError, Tab, needs_browser
from tests.studies.explore.test_explorer import OSCILLATOR, ROD, unpacked
from tests.support import MODELS, ROOT

# The shipped models with one set of equations for the whole run.
HELD = (
    "andrews", "appell-hamel", "bead-hoop", "bead-hoop-cartesian", "bicycle",
    "car-axis", "chain-angles", "chain-cartesian", "chain-on-a-cart",
    "chaplygin-sleigh", "charged-particle", "coupled-oscillators", "double-pendulum",
    "elastic-pendulum", "elastic-pendulum-curve", "elastic-pendulum-forced",
    "elastic-pendulum-steered", "forced-oscillator", "heavy-top", "heavy-top-angles",
    "heavy-top-quaternion", "henon-heiles", "kepler", "moving-pivot",
    "outer-solar-system", "pendulum-cartesian", "rolling-disk", "rolling-disk-steady",
    "seven-joint-arm", "spacecraft", "vibration-absorber", "von-mises-truss",
    "ziegler-column",
)  # fmt: skip
POINTS = "[[0, 0], [1, 2], [9, 3]], interpolation: cubic"
EVENT = "modes: {on: 1}\nevents: {off: {at: x <= 0, set: {on: 0}}}\nforces: {x: on}\n"
OTHERS = sorted({x.stem for x in MODELS.glob("*.yaml")} - {*HELD})


def test_the_page_has_every_function_of_the_language():
    """JavaScript evaluates start values, and has each function a second time."""
    script = ROOT / "lagsim" / "outputs" / "animation" / "numbers.js"
    text = script.read_text(encoding="utf-8")
    table = text.partition("const FUNCTIONS = {")[2].partition("\n};")[0]
    entry = re.compile(r'(?:^|[,{])\s*"?([a-z][\w.]*)"?(?=\s*[:,])', re.MULTILINE)
    data = {name for name in OPERATIONS if name.startswith(("table.", "elements."))}
    assert {*FUNCTIONS, *OPERATIONS} - data <= {*entry.findall(table)}
    block = text.partition("const ARITY")[2].partition("\n]);")[0]
    groups = re.findall(r'"([\w ]+)"\.split\(" "\)\.map\(\(x\) => \[x, (\d)', block)
    groups += re.findall(r'\["(\w+)", (\d)\]', block)
    read = {name: int(count) for names, count in groups for name in names.split()}
    assert read == {name: row.arity for name, row in FUNCTIONS.items()}


def explorer_of(path, vary=(), **overrides):
    return Explorer(str(path), overrides, dict(vary), error_text)


@pytest.fixture(scope="module")
def oscillator(tmp_path_factory):
    path = tmp_path_factory.mktemp("file") / "oscillator.yaml"
    path.write_text(OSCILLATOR)
    return path


@pytest.fixture(scope="module")
def page(oscillator):
    return page_in_a_file(explorer_of(oscillator))


# --- The file


@pytest.mark.parametrize(
    ("more", "feature"),
    [
        ("constraints: {wall: {relation: x >= -1, restitution: 0.5}}", "`wall`"),
        ("forces: {x: -0.1*sign(x_dot)}", "`sign(x_dot)`"),
        ("forces: {x: floor(2*t)}", "`floor(2*t)`"),
        (f"tables: {{f: {{points: {POINTS}}}}}\nforces: {{x: f(t)}}", "the table `f`"),
        (EVENT, "`off`"),
    ],
)  # fmt: skip
def test_what_a_page_cannot_compute_is_refused_by_its_name(tmp_path, more, feature):
    path = tmp_path / "other.yaml"
    path.write_text(f"{OSCILLATOR}{more}\n")
    with pytest.raises(LagsimError) as refused:
        page_in_a_file(explorer_of(path))
    assert refused.value.code == "not-in-a-file"
    assert feature in str(refused.value)


@pytest.mark.parametrize(
    ("change", "feature"),
    [("duration: 3", "duration: 3, until: x <= 0"),
     ("initial: {x: 0.5, x_dot: 0}\nsimulation: {",
      "initial: {x: {guess: 0}}\nsimulation: {begin: rest, "),
     ("output_step: 0.5", "output_step: 0.5, rtol: 1e-9*k")],
)  # fmt: skip
def test_ends_and_tolerances_that_vary_are_refused(tmp_path, change, feature):
    path = tmp_path / "other.yaml"
    path.write_text(OSCILLATOR.replace(change, feature))
    with pytest.raises(LagsimError) as refused:
        page_in_a_file(explorer_of(path))
    assert refused.value.code == "not-in-a-file"


def parts_of(page):
    found = re.findall(
        rb'<script type="[^"]*" id="(\w+)"[^>]*>(.*?)</script>', page, re.DOTALL
    )
    return {name.decode(): content for name, content in found}


def unpacked_part(content):
    return zlib.decompress(base64.b85decode(content.replace(b".", b"<")))


def test_the_page_may_run_its_own_script_alone(page):
    [policy] = re.findall(rb'Content-Security-Policy" content="([^"]*)"', page)
    [script] = re.findall(rb"<script>(.*?)</script>", page, re.DOTALL)
    own = unpacked_part(parts_of(page)["script"])
    first, second = (
        base64.b64encode(hashlib.sha256(x).digest()).decode() for x in (script, own)
    )
    rules = dict(x.strip().split(" ", 1) for x in policy.decode().split(";"))
    assert rules["default-src"] == "'none'"
    allowed = f"'sha256-{first}' 'sha256-{second}' 'wasm-unsafe-eval'"
    assert rules["script-src"] == allowed
    assert rules["worker-src"] == "blob:"
    assert "connect-src" not in rules
    foreign = rb"(src|href)=|https?://|\beval\(|new Function"
    assert not re.search(foreign, re.sub(rb'<script type="text/plain".*', b"", page))
    for name in ("script", "worker"):
        assert not re.search(foreign, unpacked_part(parts_of(page)[name]))


def test_a_small_model_has_a_small_page(page):
    assert len(page) < 110_000
    assert unpacked_part(parts_of(page)["module"])[:4] == b"\0asm"


@pytest.mark.slow
@pytest.mark.parametrize("name", HELD)
def test_a_page_without_its_equations_is_small(name):
    page = page_in_a_file(explorer_of(MODELS / f"{name}.yaml"))
    assert len(page) - len(parts_of(page)["mathml"]) < 250_000


def test_the_parts_of_a_page_are_no_tags(page):
    for content in parts_of(page).values():
        assert b"<" not in content
        assert re.fullmatch(rb"[!-~]*", content)


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_the_other_shipped_models_are_refused(name):
    with pytest.raises(LagsimError) as refused:
        page_in_a_file(explorer_of(MODELS / f"{name}.yaml"))
    assert refused.value.code == "not-in-a-file"


# --- In a browser

slow = [needs_browser, pytest.mark.slow]


def in_browser(test):
    for mark in slow:
        test = mark(test)
    return test


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    with Tab(tmp_path_factory.mktemp("browser")) as made:
        yield made


def opened(tab, folder, explorer, fragment=""):
    """Show the page of an explorer."""
    path = folder / "page.html"
    path.write_bytes(page_in_a_file(explorer))
    tab.open(path.as_uri() + fragment)
    assert not tab.messages
    return tab


# Answers of a worker of the page's own, to requests as those of its engine.
ASKED = """(async () => {
  const source = URL.createObjectURL(new Blob([await parts.source]));
  const worker = new Worker(source), found = [];
  const ask = (request) => new Promise((done) => {
    worker.onmessage = ({data}) => done(data);
    worker.postMessage(request);
  });
  const [model, module] = await Promise.all([parts.content, parts.module]);
  await ask({id: 1, kind: "open", model, module});
  let id = 1;
  for (const request of REQUESTS) found.push(await ask({id: ++id, ...request}));
  worker.terminate();
  const plain = (x) => x && typeof x === "object" && !Array.isArray(x)
    ? ArrayBuffer.isView(x) ? Array.from(x, plain)
      : Object.fromEntries(Object.entries(x).map(([k, v]) => [k, plain(v)]))
    : Array.isArray(x) ? x.map(plain)
    : typeof x === "number" && !Number.isFinite(x) ? String(x) : x;
  return JSON.stringify(plain(found));
})()"""


def asked(tab, *requests):
    return json.loads(tab.run(ASKED.replace("REQUESTS", json.dumps(requests))))


@in_browser
@pytest.mark.parametrize("name", HELD)
def test_a_model_moves_as_its_run_does_in_all_bits(tab, tmp_path, monkeypatch, name):
    monkeypatch.setenv("LAGSIM_CPU", "portable")
    path = MODELS / f"{name}.yaml"
    opened(tab, tmp_path, explorer_of(path))
    run = lagsim.simulate(lagsim.load(path), error_bar="never")
    first, last = float(run["t"][0]), float(run["t"][-1])
    for t in (first, first + 0.37 * (last - first), last):
        found = tab.run(f"lagsim.advance({t!r})")
        assert found == tab.state
        right = {name: run.at(t)[name] for name in found}
        if name == "andrews":
            # A page solves closed loops by M^-1, a run by independent coordinates, both
            # to rtol 1e-11 of the ranges.
            right = pytest.approx(right, rel=1e-9, abs=1e-9)
        assert found == right
    assert not tab.messages


@in_browser
@pytest.mark.parametrize("name", HELD)
def test_the_film_of_a_motion_is_that_of_the_live_page(
    tab, tmp_path, monkeypatch, name
):
    # With other functions of the C library a chaotic motion departs by their last bits.
    monkeypatch.setenv("LAGSIM_CPU", "portable")
    explorer = explorer_of(MODELS / f"{name}.yaml")
    opened(tab, tmp_path, explorer)
    [answer] = asked(tab, {"kind": "motion", "values": {}})
    found, (header, _) = answer["found"], unpacked(explorer.motion({}, "page"))
    film = header["film"]
    size = max(b - a for a, b in film["box"]) or 1.0
    alike(found["film"] | {"energies": {}}, film | {"energies": {}}, size)
    energies = film["energies"]
    assert found["film"]["energies"].keys() == energies.keys()
    most = max(np.abs(decoded(x, "<f4")).max() for x in energies.values())
    for key, text in energies.items():
        close(found["film"]["energies"][key], decoded(text, "<f4"), most)
    for key in ("columns", "rows", "state", "units", "ends", "held"):
        assert found[key] == header[key], key
    assert found["values"] == pytest.approx(header["values"], rel=1e-12)


def decoded(text, kind):
    return np.frombuffer(base64.b64decode(text), kind)


def close(found, expected, size):
    """Compare numbers of single precision."""
    found = np.array([float(x) for x in found])
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * size)


def alike(found, expected, size, path="film"):
    """Compare the films of two engines: the live one packs its arrays as text."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys(), path
        for key, x in expected.items():
            alike(found[key], x, size, f"{path}.{key}")
    elif isinstance(expected, str) and isinstance(found, list):
        numbers = decoded(expected, "<f8" if path == "film.t" else "<f4")
        most = np.nanmax(np.abs(numbers), initial=size)
        close(found, numbers, most)
    elif isinstance(expected, list):
        assert len(found) == len(expected), path
        for k, (x, y) in enumerate(zip(found, expected, strict=True)):
            alike(x, y, size, f"{path}[{k}]")
    elif isinstance(expected, float) and not isinstance(found, str):
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-9 * size), path
    else:
        assert found == expected, path


# Values of parameters, start values, guesses, lengths of rows and ends of runs.
SET = [
    ("elastic-pendulum", {"K": 30, "theta": "pi/5"}),
    ("pendulum-cartesian", {"L": "1 + 1/3", "g": 3}),
    ("rolling-disk", {"r": 0.7}),
    ("heavy-top-angles", {"m": 12, "g": 5}),
    ("car-axis", {"L": 1.1, "r": 0.05}),
    ("andrews", {"m.1": 0.05}),
    ("bicycle", {"v": 4.7}),
    ("spacecraft", {"M": 90}),
    ("kepler", {"e": 0.2}),
    ("chain-cartesian", {"l": 0.12}),
    ("elastic-pendulum-curve", {"K": 20}),
    ("henon-heiles", {"E": 0.09}),
]


@in_browser
@pytest.mark.parametrize(("name", "values"), SET)
def test_set_gives_the_run_with_these_values(tab, tmp_path, name, values):
    path = MODELS / f"{name}.yaml"
    opened(tab, tmp_path, explorer_of(path))
    run = lagsim.simulate(lagsim.load(path, **values), error_bar="never")
    t = float(run["t"][0] + 0.1 * (run["t"][-1] - run["t"][0]))
    tab.run(f"lagsim.advance({t!r})")
    tab.run(f"lagsim.set({json.dumps(values)})")
    found = tab.state
    assert found["t"] == t
    for name, value in found.items():
        extent = float(np.ptp(run[name]))
        assert abs(value - run.at(t)[name]) <= 1e-9 * max(extent, 1e-300), name


@in_browser
def test_what_is_refused_leaves_the_state_and_has_the_code_of_the_command(
    tab, tmp_path
):
    explorer = explorer_of(MODELS / "pendulum-cartesian.yaml")
    opened(tab, tmp_path, explorer)
    tab.run("lagsim.advance(1)")
    before = tab.state
    cases = [
        {"nothing": 1}, {"g": "1/0"}, {"g": "alert(1)"}, {"g": "2*"}, {"g": "(2"},
        {"g": "2)"}, {"g": "x"}, {"g": "g"}, {"m": "2*L"}, {"g": "min(1)"},
        {"g": "2 3"}, {"g": "1e999"}, {"g": "1 < 2"}, {"g": "2k"}, {"g": "$"},
        {"g": " "}, {"x": 3}, {"x": "0.3", "x_dot": "1"}, {"m": 0}, {"m": -1},
        {"x": 1e308}, {"g": "y_dot"}, {"g": "__import__('os')"},
    ]  # fmt: skip
    for values in cases:
        texts = {name: str(x) for name, x in values.items()}
        with pytest.raises(LagsimError) as refused:
            explorer.motion(texts, "page")
        expected = re.findall(r"\[(E\d+)\]", error_text(refused.value))
        with pytest.raises(RefusedError):
            tab.run(f"lagsim.set({json.dumps(values)})")
        assert re.findall(r"\[(E\d+)\]", tab.error)[:1] == expected[:1], values
        assert tab.state == before
    with pytest.raises(RefusedError):
        tab.run("lagsim.set({g: NaN})")
    tab.run("lagsim.set({g: 5})")
    assert not tab.error
    assert tab.run("location.hash") == "#g=5&t=1"


FAR = """
parameters: {L: 1, far: 1e6}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {rod: (x - far)^2 + y^2 = L^2}
initial: {x: far + L, y: 0, y_dot: 1}
simulation: {duration: 1}
"""


@in_browser
def test_a_start_far_from_the_origin_is_judged_by_the_lengths_of_its_constraints(
    tab, tmp_path
):
    path = tmp_path / "far.yaml"
    path.write_text(FAR)
    explorer = explorer_of(path)
    opened(tab, tmp_path, explorer)
    for text, admissible in (
        ("far + 1.001*L", False),
        ("far + 1.00001*L", False),
        ("far + L*(1 + 1e-7)", True),
        ("far - L", True),
    ):
        [answer] = asked(tab, {"kind": "motion", "values": {"x": text}})
        assert ("found" in answer) is admissible, text
        if admissible:
            explorer.motion({"x": text}, "page")
            continue
        with pytest.raises(LagsimError) as refused:
            explorer.motion({"x": text}, "page")
        # The bound is that of the command, not one that grows with the distance.
        bound = r"bound [-.e\d]+, [^)]*"
        assert re.findall(bound, answer["error"]) == re.findall(
            bound, error_text(refused.value)
        )


@in_browser
def test_a_later_motion_ends_a_long_one_and_the_last_counts(tab, tmp_path):
    path = tmp_path / "long.yaml"
    path.write_text(OSCILLATOR.replace("duration: 3", "duration: 3*m^8"))
    explorer = explorer_of(path, m="1")
    opened(tab, tmp_path, explorer)
    # Five million seconds take some seconds of computation.
    tab.run("(lagsim.set({m: 6}).catch(() => {}), 1)")
    tab.run("(document.querySelector('input[name=m]').value = '1.1', 1)")
    tab.run(
        "(document.querySelector('input[name=m]')"
        ".dispatchEvent(new Event('change')), 1)"
    )
    tab.wait("location.hash.includes('m=1.1')")
    run = lagsim.simulate(lagsim.load(path, m=1.1), error_bar="never")
    found = tab.run("lagsim.advance(1e9)")
    assert found["t"] == pytest.approx(3 * 1.1**8, rel=1e-12)
    for name, value in found.items():
        assert value == pytest.approx(run[name][-1], abs=1e-9)


@in_browser
def test_a_thousand_motions_leave_the_memory_of_the_page_flat(
    tab, tmp_path, oscillator
):
    opened(tab, tmp_path, explorer_of(oscillator))
    many = "(async () => { for (let k = 0; k < COUNT; k++) "
    many += "await lagsim.set({k: 2 + (k % 50) / 10}); })()"

    def used():
        tab.send("HeapProfiler.collectGarbage")
        return tab.send("Runtime.getHeapUsage")["usedSize"]

    tab.run(many.replace("COUNT", "100"))
    before = used()
    tab.run(many.replace("COUNT", "1000"))
    # A motion of this page has some 100 kB.
    assert used() - before < 3e6


@in_browser
def test_a_failed_run_says_so_and_the_last_good_motion_stays(tab, tmp_path):
    path = tmp_path / "escape.yaml"
    path.write_text(
        "parameters: {a: 0}\ncoordinates: {x: {}}\n"
        "energy: {kinetic: x_dot^2/2, potential: -a*x^3/3}\n"
        "initial: {x: 1}\nsimulation: {duration: 10}\n"
    )
    explorer = explorer_of(path)
    opened(tab, tmp_path, explorer)
    header, _ = unpacked(explorer.motion({"a": 1.0}, "page"))
    before = tab.run("lagsim.advance(2)")
    with pytest.raises(RefusedError):
        tab.run("lagsim.set({a: 1})")
    expected, found = header["error"], tab.error
    assert found.split(" at t = ")[0] == expected.split(" at t = ")[0]
    assert re.findall(r"\[(E\d+)\]", found) == re.findall(r"\[(E\d+)\]", expected)
    assert tab.run("document.body.classList.contains('stale')")
    assert tab.state == before


@in_browser
@pytest.mark.parametrize(
    ("name", "point", "target"),
    [
        ("pendulum-cartesian", "mass", [0.3, -0.2]),
        ("double-pendulum", "lower", [0.5, -1.2]),
        ("chain-cartesian", "p5", [0.2, -0.3]),
        ("heavy-top-quaternion", "centre", [0.3, 0.2, 0.5]),
    ],
)
def test_a_dragged_point_is_where_the_live_page_drags_it(
    tab, tmp_path, name, point, target
):
    explorer = explorer_of(MODELS / f"{name}.yaml")
    opened(tab, tmp_path, explorer)
    expected = explorer.drag({}, 0.5, point, target, "page")
    request = {"kind": "drag", "values": {}, "t": 0.5, "point": point, "target": target}
    [answer] = asked(tab, request)
    size = max(1.0, *map(abs, expected.values()))
    assert answer["found"] == pytest.approx(expected, abs=1e-6 * size)


@in_browser
@pytest.mark.parametrize(
    ("name", "start", "value"),
    [
        ("pendulum-cartesian", "x", 0.3),
        ("pendulum-cartesian", "y_dot", 1.0),
        ("bead-hoop-cartesian", "x", 0.2),
        ("andrews", "beta", 0.1),
        ("rolling-disk", "x_dot", 1.0),
        ("car-axis", "yl", 0.45),
        ("double-pendulum", "theta1", 0.3),
    ],
)
def test_a_start_value_slides_on_the_constraints_as_on_the_live_page(
    tab, tmp_path, name, start, value
):
    explorer = explorer_of(MODELS / f"{name}.yaml")
    opened(tab, tmp_path, explorer)
    request = {"kind": "start", "values": {}, "name": start, "value": value}
    [answer] = asked(tab, request)
    expected = explorer.start({}, start, value)
    names = expected.keys() | answer["found"].keys()
    [before] = [unpacked(explorer.motion({}, "page"))[0]["values"]]
    # Newton's method ends where a step is within rounding of the coordinates.
    for key in names:
        found = answer["found"].get(key, before[key])
        assert found == pytest.approx(expected.get(key, before[key]), abs=1e-9), key


@in_browser
def test_the_model_file_has_the_values_set(tab, tmp_path):
    for name, values in (
        ("pendulum-cartesian", {"g": "3", "x": "-0.6", "y": "0.8", "x_dot": "1e-7"}),
        ("elastic-pendulum", {"K": "100/3"}),
        ("kepler", {"e": "0.25"}),
    ):
        explorer = explorer_of(MODELS / f"{name}.yaml")
        opened(tab, tmp_path, explorer)
        [answer] = asked(tab, {"kind": "file", "values": values})
        assert answer["found"] == explorer.text(values)


@in_browser
def test_the_address_holds_settings_and_time(tab, tmp_path):
    path = MODELS / "elastic-pendulum.yaml"
    opened(tab, tmp_path, explorer_of(path), "#K=30&theta=pi%2F5&t=1.5")
    run = lagsim.simulate(lagsim.load(path, K=30, theta="pi/5"), error_bar="never")
    found = tab.run("lagsim.advance(1.5)")
    for name, value in found.items():
        assert value == pytest.approx(run.at(1.5)[name], rel=1e-9, abs=1e-9)
    tab.run("document.getElementById('reset').click()")
    tab.wait("location.hash === '#t=1.5'")
    tab.run("document.querySelector('#equations').open = true, 1")
    tab.wait("document.querySelectorAll('math').length >= 2")
    assert not tab.messages


@in_browser
@pytest.mark.parametrize(
    "name", ["chain-cartesian", "andrews", "car-axis", "bead-hoop-cartesian"]
)
def test_a_start_that_is_dragged_far_away_is_admissible(tab, tmp_path, name):
    explorer = explorer_of(MODELS / f"{name}.yaml")
    opened(tab, tmp_path, explorer)
    model, settings = (
        lagsim.load(MODELS / f"{name}.yaml"),
        explorer.session.case.settings,
    )
    points = stage(explorer.model).points
    draw = np.random.default_rng([50, *name.encode()])
    requests = []
    for point, parts in points.items():
        t = settings.start + draw.uniform(0.0, 0.3) * settings.duration
        target = 10.0 ** draw.uniform(-1.0, 3.0) * draw.normal(size=len(parts))
        request = {"kind": "drag", "values": {}, "t": float(t), "point": point}
        requests.append(request | {"target": target.tolist()})
    for request, answer in zip(requests, asked(tab, *requests), strict=True):
        values = {name: float(x) for name, x in answer["found"].items()}
        assert lagsim.check(model.bind(**values)).admissible, request


@in_browser
def test_the_start_follows_the_slider_of_a_parameter(tab, tmp_path):
    path = tmp_path / "rod.yaml"
    path.write_text(ROD)
    opened(tab, tmp_path, explorer_of(path))
    tab.run("lagsim.advance(0)")
    tab.run("""(() => {
      const slider = document.querySelector("input[type=range][name=L]");
      slider.value = 1.5;
      slider.dispatchEvent(new Event("input"));
    })()""")
    tab.wait("location.hash.includes('L=1.5')", 20)
    assert not tab.error
    found = tab.run("lagsim.advance(0)")
    assert [found["x"], found["y"]] == pytest.approx([0.9, -1.2], rel=1e-12)
    # A value that a script sets moves no other.
    with pytest.raises(RefusedError):
        tab.run("lagsim.set({L: 2})")
