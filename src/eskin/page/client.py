"""This module adapts the page of viser, which runs in the browser, to eskin."""

import re

TITLE = b"<title>eskin</title>"
"""Title of the page in the browser, in place of viser's."""

NO_SCENE = b"""<script>
  const getContext = HTMLCanvasElement.prototype.getContext;
  const canDraw = () => {
    try {
      return getContext.call(document.createElement("canvas"), "webgl2") !== null;
    } catch {
      return false;
    }
  };
  if (!canDraw()) {
    const GL = window.WebGL2RenderingContext ?? {};
    const COUNTS = [GL.ACTIVE_UNIFORMS, GL.ACTIVE_ATTRIBUTES];
    const answers = {
      getContextAttributes: () => ({}),
      getShaderPrecisionFormat: () => ({precision: 23, rangeMin: 127, rangeMax: 127}),
      getParameter: (name) => ({
        [GL.VERSION]: "WebGL 2.0", [GL.SHADING_LANGUAGE_VERSION]: "WebGL GLSL ES 3.00",
        [GL.VIEWPORT]: [0, 0, 1, 1], [GL.SCISSOR_BOX]: [0, 0, 1, 1],
      })[name] ?? 4096,
      getProgramParameter: (program, name) => COUNTS.includes(name) ? 0 : true,
      getShaderParameter: () => true,
      getProgramInfoLog: () => "",
      getShaderInfoLog: () => "",
      getSupportedExtensions: () => [],
      checkFramebufferStatus: () => GL.FRAMEBUFFER_COMPLETE,
    };
    const get = (known, name) => {
      if (name in known || typeof name === "symbol") return known[name];
      if (name === name.toUpperCase()) return GL[name];
      return answers[name] ?? (() => name.startsWith("create") ? {} : null);
    };
    HTMLCanvasElement.prototype.getContext = function (kind, ...options) {
      if (!kind.startsWith("webgl")) return getContext.call(this, kind, ...options);
      const known = {canvas: this, drawingBufferWidth: 1, drawingBufferHeight: 1};
      return this.drawsNothing ??= new Proxy(known, {get});
    };
    // Nobody touches what they do not see.
    for (const kind of ["pointerdown", "pointermove", "pointerup", "click"])
      addEventListener(kind, (event) => {
        if (event.target.dataset?.engine) event.stopImmediatePropagation();
      }, true);
    addEventListener("DOMContentLoaded", () => {
      const told = document.createElement("p");
      told.id = "no-scene";
      told.textContent = "The robot is not drawn, because this browser has no WebGL: " +
        "turn on hardware acceleration in its settings, or use another browser. " +
        "The panel works without.";
      document.body.append(told);
    });
  }
</script>
<style>
  #no-scene {
    position: fixed; top: 200px; left: 20px; z-index: 80; max-width: 24em;
    pointer-events: none; font: 16px/1.5 system-ui, sans-serif;
    color: light-dark(#1f2733, #e3e8ee); }
</style>"""
"""Lets the page work in a browser without WebGL, and says there that nothing is drawn.

Viser handles what it is sent before it draws, so it is given a context that draws
nothing."""

LOOK = b"""<script>
  if (matchMedia("(prefers-color-scheme: dark)").matches && !location.search)
    history.replaceState(null, "", "?darkMode");
  let at = null, told = 0, held = 0;
  const hasMoved = (event) => Math.max(
    Math.abs(event.clientX - at[0]), Math.abs(event.clientY - at[1])) > 3;
  const hold = ({clientX, clientY, pointerId}) => {
    for (const step of [4, 0])
      dispatchEvent(new PointerEvent(
        "pointermove", {clientX: clientX + step, clientY, pointerId, buttons: 1}));
  };
  addEventListener("pointerdown", (event) => {
    const isScene = event.button === 0 && event.target.dataset?.engine;
    at = isScene ? [event.clientX, event.clientY] : null;
    clearTimeout(held);
    const isPlain = !(event.shiftKey || event.ctrlKey || event.altKey || event.metaKey);
    if (isScene && isPlain) held = setTimeout(hold, 250, event);
  }, true);
  addEventListener("pointermove", (event) => {
    if (at !== null && hasMoved(event)) clearTimeout(held);
  }, true);
  addEventListener("pointerup", (event) => {
    clearTimeout(held);
    if (at === null) return;
    const key = hasMoved(event) ? "T" : "M";
    clearTimeout(told);
    told = setTimeout(() => document.documentElement.dispatchEvent(
      new KeyboardEvent("keydown", {key, code: "Key" + key, bubbles: true})), 60);
    at = null;
  }, true);
  let audio = null, banner = null, hasArm = false;
  const wake = () => {
    try { (audio ??= new AudioContext()).resume(); } catch { audio = null; }
  };
  for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, wake, true);
  const sound = () => {
    if (audio?.state !== "running") return;
    [660, 880].forEach((pitch, number) => {
      const tone = audio.createOscillator(), loudness = audio.createGain();
      const begin = audio.currentTime + 0.12 * number;
      tone.frequency.value = pitch;
      loudness.gain.setValueAtTime(0.25, begin);
      loudness.gain.exponentialRampToValueAtTime(0.001, begin + 0.12);
      tone.connect(loudness).connect(audio.destination);
      tone.start(begin);
      tone.stop(begin + 0.12);
    });
  };
  const CLOSED = {
    question: "", hint: "Open the panel to see what the arm asks", left: 0};
  const write = (part, text) => {
    if (part.textContent !== text) part.textContent = text;
  };
  new MutationObserver(() => {
    const asked = document.querySelector("[data-question]");
    const {question, hint, left} = asked?.dataset ?? CLOSED;
    hasArm ||= asked !== null;
    if (!hasArm || !hint) {
      banner?.remove();
      banner = null;
      return;
    }
    if (!banner) {
      banner = document.createElement("div");
      banner.id = "question";
      banner.setAttribute("role", "alert");
      banner.innerHTML = "<b></b><span></span><i></i>";
      document.body.append(banner);
    }
    const [title, text, bar] = banner.children;
    if (question && !title.textContent) sound();
    write(title, question);
    write(text, hint);
    bar.style.width = `${100 * left}%`;
    const box = document.querySelector("canvas[data-engine]")?.getBoundingClientRect();
    if (box) Object.assign(banner.style, {left: `${box.x}px`, width: `${box.width}px`});
  }).observe(document, {childList: true, subtree: true});
</script>
<style>
  #question {
    position: fixed; top: 0; left: 0; width: 100%; z-index: 90;
    pointer-events: none;
    box-sizing: border-box; padding: 14px 20px; overflow: hidden;
    font: 600 clamp(20px, 3.2vw, 44px)/1.25 system-ui, sans-serif;
    text-align: center; color: #fff; background: #14405ae6; }
  #question span { display: block; font-size: 0.7em; }
  #question i {
    display: block; height: 12px; margin: 10px auto 0; border-radius: 6px;
    background: #ffc94d; transition: width 0.1s linear; }
  :root { color-scheme: light dark; }
  [data-mantine-color-scheme="light"] { color-scheme: light; }
  [data-mantine-color-scheme="dark"] { color-scheme: dark; }
  canvas[data-engine] {
    background: linear-gradient(
      light-dark(#e0e7f0, #2a313b), light-dark(#fafbfd, #14181d));
  }
  :root { --mantine-color-dimmed: light-dark(#596372, #b0b9c4) !important; }
  .mantine-ScrollArea-content { box-sizing: border-box; padding-right: 8px; }
  [role="tab"] { padding: 0 0.55em !important; }
  @media (max-height: 850px) {
    body:has([role="tab"]:not(:first-child)[aria-selected="true"]) {
      .eskin-brief { display: none; }
      .eskin-log { height: 60px !important; }
    }
  }
  .mantine-Button-root { min-height: 28px; }
  [role="tab"][aria-selected="true"] {
    color: light-dark(#14677a, #5fd0e3) !important; }
  @media (pointer: coarse) { .mantine-Button-root { min-height: 40px; } }
  @media (max-width: 36em) {
    [style*="max-height: 60%"] { width: 100% !important;
      max-height: 44% !important; }
    [style*="max-height: 60%"] [style="width: 20em;"] { width: 100% !important; }
  }
</style>"""
"""Additions to viser's page: it is dark where the browser prefers that; each click
and drag in the scene is told by a key, M or T, so that those beside the skin are
answered too, after 60 ms, because what it hit is told within 50 ms; what the arm asks
is shown across the scene, with a sound where the browser allows one, which is after the
first click or key; the sky is pale or dark; names of controls are as dark as other
small print, and controls lie beside the bar that scrolls; in a low window explanations
give way to the tabs beside the first; and on a phone the panel is as wide as the
window, and lower.

Viser tells of a press only once it moves. So one that has stayed in its place for
250 ms is moved by a few points and back: it begins as a drag does, and lasts until it
is released."""


def adapt(page: bytes) -> bytes:
    """Return viser's page with eskin's title, look and help where nothing is drawn."""
    titled = re.sub(rb"<title>[^<]*</title>", TITLE, page, count=1)
    return titled.replace(b"<head>", b"<head>" + NO_SCENE + LOOK, 1)
