"""A picture of a trace: the world from above, with the paths of the vehicles."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple
from xml.sax.saxutils import escape

Point = Tuple[float, float]
_COLOURS = ["#0a66c2", "#c2410c", "#15803d", "#7e22ce", "#b91c1c", "#0f766e"]
_LARGEST = 800.0


def draw(trace: Path, state: Optional[Dict[str, Any]], to: Path) -> None:
    """Draws the trace; ``state`` is what :meth:`Control.state` has said last, for what stands around."""
    paths: Dict[int, List[Point]] = {}
    try:
        lines = trace.read_text().splitlines()
    except OSError:
        return
    for line in lines:
        if '"kind":"pose"' in line:
            pose = json.loads(line)
            paths.setdefault(pose["device"], []).append((pose["x"], pose["y"]))
    points = [point for path in paths.values() for point in path] or [(0.0, 0.0)]
    low = [min(point[axis] for point in points) - 2.0 for axis in (0, 1)]
    high = [max(point[axis] for point in points) + 2.0 for axis in (0, 1)]
    scale = _LARGEST / max(high[0] - low[0], high[1] - low[1])

    def at(point: Point) -> str:
        return f"{(point[0] - low[0]) * scale:.1f},{(high[1] - point[1]) * scale:.1f}"

    width, height = ((high[axis] - low[axis]) * scale for axis in (0, 1))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}">',
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#f7f7f4"/>',
    ]
    world = (state or {}).get("world", {})
    for kind, colour in (("areas", "#d9e6ef"), ("obstacles", "#5b646a")):
        for one in world.get(kind, []):
            corners = " ".join(at((x, y)) for x, y in one["outline"])
            parts.append(f'<polygon points="{corners}" fill="{colour}"/>')
    for strip in world.get("strips", []):
        ends = f"{at(tuple(strip['from']))} {at(tuple(strip['to']))}"
        parts.append(f'<polyline points="{ends}" stroke="#2c2c2c" stroke-width="2"/>')
    names = [device["name"] for device in (state or {}).get("devices", [])]
    for device, path in sorted(paths.items()):
        colour = _COLOURS[device % len(_COLOURS)]
        corners = " ".join(at(point) for point in path)
        parts.append(f'<polyline points="{corners}" fill="none" stroke="{colour}" stroke-width="3"/>')
        x, y = at(path[-1]).split(",")
        name = escape(names[device]) if device < len(names) else str(device)
        parts.append(f'<circle cx="{x}" cy="{y}" r="6" fill="{colour}"/><text x="{x}" y="{y}" dx="9">{name}</text>')
    metre = 10.0 ** math.floor(math.log10(max(high[0] - low[0], 1.0) / 2))
    parts.append(
        f'<path d="M12 {height - 12:.0f}h{metre * scale:.1f}" stroke="#1d2327" stroke-width="2"/>'
        f'<text x="14" y="{height - 18:.0f}">{metre:g} m</text></svg>'
    )
    to.write_text("\n".join(parts))
