"""Moving pictures of a motion: GIF, or MP4 where ffmpeg is installed."""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.motion.records import Motion
from pmopt.errors import InputError, PmoptError
from pmopt.mechanisms import Mechanism
from pmopt.reporting.pictures.drawing import draw_frames

Frame = NDArray[np.uint8]
#: Frames a second, in real time, unless asked otherwise; GIF counts in hundredths of a second.
DEFAULT_FPS = 20.0
FPS_RANGE = (0.1, 50.0)
#: Most frames: a GIF of them has some hundred MB.
MAX_FRAMES = 5000
KINDS = (".gif", ".mp4")


def check_animation(path: Path, fps: float, force: bool) -> None:
    """Refuse what cannot be written, before anything is computed.

    Raises
    ------
    InputError
        For another kind of file, an existing one without ``force``, and MP4 without ffmpeg.
    """
    if path.suffix.lower() not in KINDS:
        raise InputError(f"--animate: {path} is not allowed: a name ending in .gif or .mp4")
    if not FPS_RANGE[0] <= fps <= FPS_RANGE[1]:
        raise InputError(
            f"--fps: {fps:g} is not allowed: {FPS_RANGE[0]:g} to {FPS_RANGE[1]:g} frames a second"
        )
    if path.exists() and not force:
        raise InputError(f"--animate: {path} exists; --force overwrites it")
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(f"--animate: {path} needs ffmpeg, which is not installed; .gif does not")


def animate(
    mechanism: Mechanism,
    motion: Motion,
    path: Path,
    fps: float = DEFAULT_FPS,
    progress: Callable[[int, int], None] | None = None,
    gravity: Sequence[float] | None = None,
) -> bytes:
    """Draw a motion in real time.

    Parameters
    ----------
    mechanism : Mechanism
    motion : Motion
        Feasible throughout.
    path : Path
        Its ending gives the kind of file; nothing is written.
    fps : float
        Frames a second.
    progress : callable, optional
        Receives the frames drawn and their number.
    gravity : (3,) of float, optional
        In the base frame; default: as the mechanism stands.

    Returns
    -------
    bytes
        The file's content.

    Raises
    ------
    InputError
        For more frames than :data:`MAX_FRAMES`.
    """
    start, duration = float(motion.t[0]), float(motion.t[-1] - motion.t[0])
    count = max(2, int(duration * fps * (1 + 1e-12)) + 1)
    if count > MAX_FRAMES:
        raise InputError(
            f"--fps: {fps:g} makes {count} frames of {duration:g} s, at most {MAX_FRAMES} are "
            "allowed"
        )
    times = start + np.minimum(np.arange(count) / fps, duration)
    # The nearest instant of the motion stands for a frame's time.
    after = np.clip(np.searchsorted(motion.t, times), 1, len(motion.t) - 1)
    early = times - motion.t[after - 1] < motion.t[after] - times
    chosen = after - early
    names = [c.name for c in motion.pose.coordinates]
    poses = [dict(zip(names, map(float, motion.pose.values[k]), strict=True)) for k in chosen]
    captions = [f"t = {float(motion.t[k]):.2f} s, working mode {motion.working_mode}"
                for k in chosen]  # fmt: skip
    frames = draw_frames(mechanism, motion.params, poses, captions, motion.working_mode, gravity)

    def counted() -> Iterator[Frame]:
        for number, frame in enumerate(frames, start=1):
            yield frame
            if progress is not None:
                progress(number, count)

    if path.suffix.lower() == ".mp4":
        return _to_mp4(counted(), fps)
    return _to_gif(counted(), _delays(count, fps))


def _delays(count: int, fps: float) -> list[int]:
    """Return the time of each frame in ms, whole hundredths of a second that add up."""
    ends = [round(100 * (k + 1) / fps) for k in range(count)]
    return [10 * (b - a) for a, b in zip([0, *ends[:-1]], ends, strict=True)]


def _to_gif(frames: Iterator[Frame], delays: Sequence[int]) -> bytes:
    from PIL import Image

    # One palette for all frames, from the first: colours do not flicker.
    palette: Any = None
    images = []
    for frame in frames:
        image = Image.fromarray(frame)
        if palette is None:
            palette = image.quantize(128, dither=Image.Dither.NONE)
        images.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
    buffer = io.BytesIO()
    images[0].save(
        buffer, format="GIF", save_all=True, append_images=images[1:], duration=list(delays),
        loop=0, optimize=False,
    )  # fmt: skip
    return buffer.getvalue()


def _to_mp4(frames: Iterator[Frame], fps: float) -> bytes:
    """Encode with ffmpeg, on one thread and without its own tags: the same bytes every time."""
    with tempfile.TemporaryDirectory() as folder:
        out, log = Path(folder) / "motion.mp4", Path(folder) / "log"
        first = next(frames)
        height, width = (side - side % 2 for side in first.shape[:2])
        command = [
            "ffmpeg", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
            "-s", f"{width}x{height}", "-r", f"{fps:g}", "-i", "-", "-an", "-c:v", "libx264",
            "-threads", "1", "-pix_fmt", "yuv420p", "-fflags", "+bitexact", "-flags:v", "+bitexact",
            str(out),
        ]  # fmt: skip
        with log.open("wb") as errors:
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=errors)
            assert process.stdin is not None
            try:
                for frame in (first, *frames):
                    process.stdin.write(np.ascontiguousarray(frame[:height, :width]).tobytes())
                process.stdin.close()
            except BrokenPipeError:  # ffmpeg has ended: its own words say why
                pass
            except BaseException:
                process.kill()
                raise
            finally:
                code = process.wait()
        if code != 0 or not out.exists():
            lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            raise PmoptError(f"--animate: ffmpeg: {lines[-1] if lines else f'exit code {code}'}")
        return out.read_bytes()
