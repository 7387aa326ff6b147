"""Take screenshots of the page, and measure what makes it readable.

    python -m lab.page_look --out pictures

The demonstration's page is shown at three sizes, light and dark. For each the table
counts what breaks a rule: text with a contrast below 4.5 to what is behind it (WCAG
2.2, 1.4.3); text that overlaps other text; text that is clipped; numbers that wrap;
controls below 24 px (2.5.8); colours of controls beside the accent; and numbers that
move between two readings. What breaks a rule is printed below.
"""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import tyro
from playwright.sync_api import Page

from lab.browser import see, visit_demo
from lab.tables import format_head, format_row

SIZES = ((1440, 900), (390, 844), (1024, 768))
RULES = ("contrast", "overlap", "clipped", "wrapped", "small", "accent", "moved")
SETTLED = 4000
"""Time between two readings [ms]."""

FIND = r"""() => {
  const rgb = (text) => {
    const found = text.match(/[\d.]+/g)?.map(Number) ?? [0, 0, 0, 0];
    return found.length < 4 ? [...found, 1] : found;
  };
  const light = ([r, g, b]) => [r, g, b].map((v) => v / 255).map((v) =>
    v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = (node) => {
    for (let at = node; at; at = at.parentElement) {
      const colour = rgb(getComputedStyle(at).backgroundColor);
      if (colour[3] > 0.9) return colour;
    }
    return [255, 255, 255, 1];
  };
  const panels = [...document.querySelectorAll('[style*="system-ui"]')];
  const isOurs = (node) => panels.some((panel) => panel.contains(node));
  const isShown = (node) => {
    for (let at = node; at; at = at.parentElement) {
      const style = getComputedStyle(at);
      if (style.display === "none" || style.visibility === "hidden") return false;
    }
    return true;
  };
  const broken = {contrast: [], overlap: [], clipped: [], wrapped: [], small: [],
    accent: []};
  const places = {}, boxes = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const text = walk.currentNode.textContent.trim();
    const node = walk.currentNode.parentElement;
    if (!text || !isOurs(node) || !isShown(node)) continue;
    if (["STYLE", "SCRIPT", "text"].includes(node.tagName)) continue;
    const range = document.createRange();
    range.selectNodeContents(walk.currentNode);
    const lines = [...range.getClientRects()], style = getComputedStyle(node);
    const [ink, paper] = [light(rgb(style.color)), light(behind(node))];
    const ratio = (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
    if (ratio < 4.5) broken.contrast.push(`${text}: ${ratio.toFixed(1)}`);
    if (new Set(lines.map((line) => Math.round(line.top))).size > 1 &&
      /^[\d:.,%]+( \S+)?$/.test(text)) broken.wrapped.push(text);
    for (let at = node; at && isOurs(at); at = at.parentElement) {
      const cut = getComputedStyle(at).overflowX !== "visible";
      if (cut && at.scrollWidth > at.clientWidth + 1) broken.clipped.push(text);
    }
    for (const line of lines) {
      const wide = line.right > innerWidth + 1 || line.left < -1;
      if (wide) broken.clipped.push(text);
      for (const [other, box] of boxes) {
        const x = Math.min(line.right, box.right) - Math.max(line.left, box.left);
        const y = Math.min(line.bottom, box.bottom) - Math.max(line.top, box.top);
        if (x > 2 && y > 4) broken.overlap.push(`${text} | ${other}`);
      }
    }
    lines.forEach((line) => boxes.push([text, line]));
    if (/^[\d.]+ ?(ms|%|of \d+)?$/.test(text)) {
      const key = text.replace(/[\d.]+/g, "#") + Math.round(lines[0].top);
      places[key + Math.round(lines[0].left / 60)] = lines[0].left;
    }
  }
  const accents = new Set();
  for (const button of document.querySelectorAll("button.mantine-Button-root")) {
    const box = button.getBoundingClientRect();
    if (!box.width) continue;
    if (box.height < 24 || box.width < 24)
      broken.small.push(`${button.textContent}: ${box.width}x${box.height}`);
    accents.add(getComputedStyle(button).borderColor);
  }
  if (accents.size > 1) broken.accent = [...accents];
  return {broken, places};
}"""


@dataclass(frozen=True)
class Command:
    """Measure the page."""

    out: Path = Path("pictures")
    """Folder of the screenshots."""
    seed: int = 4
    """Seed, as of `eskin demo`."""
    pace: float = 0.5
    """Seconds of simulated time per second of real time."""


def main() -> None:
    """Take the screenshots and print a table."""
    command = tyro.cli(Command)
    command.out.mkdir(parents=True, exist_ok=True)
    print(format_head(["size", "scheme", *RULES]))
    notes = []
    with visit_demo(command.seed, command.pace) as visit:
        for (width, height), scheme in product(SIZES, ("light", "dark")):
            tab = visit.tab
            tab.set_viewport_size({"width": width, "height": height})
            tab.emulate_media(color_scheme=scheme)
            see(tab, visit.demo.link)
            visit.close_notices()
            found = measure(tab)
            name = f"{width}x{height}-{scheme}"
            tab.screenshot(path=command.out / f"{name}.png")
            counts = [str(len(found[rule])) for rule in RULES]
            print(format_row([f"{width} x {height}", scheme, *counts]), flush=True)
            notes += [f"{name}: {rule}: {found[rule]}" for rule in RULES]
    print("\n".join(note for note in notes if not note.endswith("[]")))


def measure(tab: Page) -> dict[str, list[str]]:
    """Return what breaks each rule, now and between two readings."""
    first: dict[str, Any] = tab.evaluate(FIND)
    tab.wait_for_timeout(SETTLED)
    second: dict[str, Any] = tab.evaluate(FIND)
    both = first["places"].keys() & second["places"].keys()
    moved = [
        key for key in both if abs(first["places"][key] - second["places"][key]) > 1
    ]
    return second["broken"] | {"moved": moved}


if __name__ == "__main__":
    main()
