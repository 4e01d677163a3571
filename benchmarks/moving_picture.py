"""Create docs/elastic-pendulum.gif: some seconds of the animation page, frame by frame.

    python benchmarks/moving_picture.py

It needs Chromium or Chrome on the PATH; Pillow comes with matplotlib. The page's own
script draws all frames into one picture, of which the browser takes a screenshot.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

import lagsim

ROOT = Path(__file__).parent.parent
TARGET = ROOT / "docs" / "elastic-pendulum.gif"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
# Pixels of a frame; how many, how many beside each other, and a second of motion.
WIDTH, HEIGHT, FRAMES, ACROSS, RATE = 420, 400, 180, 15, 20
COLOURS = 40
# Written into the page: all frames on one canvas instead of all else.
STRIP = """
pause();
const stage = panels[0].drawing, size = [%(width)d, %(height)d];
document.body.innerHTML = "";
document.body.style.cssText = "display: block; margin: 0";
stage.canvas.style.cssText = `width: ${size[0]}px; height: ${size[1]}px`;
document.body.append(stage.canvas);
stage.resize();
const strip = document.createElement("canvas");
strip.width = %(across)d * size[0];
strip.height = Math.ceil(%(frames)d / %(across)d) * size[1];
strip.style.display = "block";
const pen = strip.getContext("2d");
pen.fillStyle = ink.card;
pen.fillRect(0, 0, strip.width, strip.height);
for (let k = 0; k < %(frames)d; k++) {
  const t = k / %(rate)d;
  stage.draw(t, {trails: {from: t - 4, fading: true}, forces: false, names: false,
    glow: 0, theme: "light", ink});
  const row = Math.floor(k / %(across)d);
  pen.drawImage(stage.canvas, k %% %(across)d * size[0], row * size[1]);
}
document.body.replaceChildren(strip);
"""


def page(folder: Path) -> Path:
    """Write the page of the run, with its frames in place of its controls."""
    result = lagsim.simulate(
        lagsim.load(ROOT / "models" / "elastic-pendulum.yaml"), error_bar="never"
    )
    result.write(folder, plots=False, animate=True)
    path = folder / "animation.html"
    script = STRIP % {
        "width": WIDTH, "height": HEIGHT, "across": ACROSS, "frames": FRAMES,
        "rate": RATE,
    }  # fmt: skip
    head, end, tail = path.read_text("utf-8").rpartition("})();")
    path.write_text(head + script + end + tail, encoding="utf-8")
    return path


def screenshot(path: Path, folder: Path) -> Image.Image:
    """Return the picture of a page as the browser draws it."""
    browser = next(found for name in BROWSERS if (found := shutil.which(name)))
    size = ACROSS * WIDTH, -(-FRAMES // ACROSS) * HEIGHT
    shot = folder / "shot.png"
    command = [
        browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
        "--force-device-scale-factor=1", f"--user-data-dir={folder / 'home'}",
        f"--window-size={size[0]},{size[1]}", f"--screenshot={shot}", path.as_uri(),
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    return Image.open(io.BytesIO(shot.read_bytes())).convert("RGB")


def main() -> None:
    """Create and write the animated picture."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = screenshot(page(folder), folder)
    # One palette for all frames: colours do not flicker.
    palette = whole.quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    frames = []
    for k in range(FRAMES):
        left, top = k % ACROSS * WIDTH, k // ACROSS * HEIGHT
        cut = whole.crop((left, top, left + WIDTH, top + HEIGHT))
        frames.append(cut.quantize(palette=palette, dither=Image.Dither.NONE))
    frames[0].save(
        TARGET, save_all=True, append_images=frames[1:], duration=1000 // RATE, loop=0,
        optimize=True,
    )  # fmt: skip
    print(f"{TARGET}: {TARGET.stat().st_size / 1e3:.0f} kB, {FRAMES} frames")


if __name__ == "__main__":
    main()
