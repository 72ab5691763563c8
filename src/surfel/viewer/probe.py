"""Probe: what has a page ask for finished pictures by itself, where no graphics card draws for it."""

from __future__ import annotations

_DOT = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="
_BY_SOFTWARE = "swiftshader|llvmpipe|softpipe|software|basic render"  # Chromium, Mesa, and Windows without a driver
_SCRIPT = """(() => {{
  const gl = document.createElement('canvas').getContext('webgl2');
  const told = gl && gl.getExtension('WEBGL_debug_renderer_info');
  const name = gl ? gl.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : gl.RENDERER) : '{software}';
  const lost = gl && gl.getExtension('WEBGL_lose_context');
  if (lost) lost.loseContext();
  if (!new RegExp('{software}', 'i').test(name)) return;
  const label = [...document.querySelectorAll('label')].find(one => one.innerText.trim() === '{label}');
  const box = label && document.getElementById(label.htmlFor);
  if (box && !box.checked) box.click();
}})()"""


def probe(label: str) -> str:
    """Return HTML that ticks the box with that label where the browser draws by software or not at all.

    The page does not tell the server what draws it. But what it loads may ask: an image of one pixel, which is there
    already, runs the question as soon as it is shown.
    """
    script = _SCRIPT.format(software=_BY_SOFTWARE, label=label)
    for sign, name in (("&", "&amp;"), ('"', "&quot;"), ("<", "&lt;")):
        script = script.replace(sign, name)
    return f'<img alt="" width="1" height="1" src="{_DOT}" onload="{script}">'
