"""Chromium without a window: it opens a page, runs a script in it, and returns what that found."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-background-networking",
)


def chromium(folder: Path, page: Path, *flags: str, anchor: str = "") -> str:
    """Open a page of the disk and return what Chromium prints; skips the test without Chromium."""
    names = ("chromium", "chromium-browser", "google-chrome")
    program = next((found for name in names if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip("no Chromium on this machine to open the page with")
    done = subprocess.run(
        [program, *FLAGS, f"--user-data-dir={folder / 'profile'}", *flags, page.as_uri() + anchor],
        check=True, capture_output=True, text=True, timeout=180,
    )  # fmt: skip
    return done.stdout


def found_in_page(folder: Path, page: str, script: str, *, anchor: str = "") -> Any:
    """Run a script in a page, as the body of an async function, and return the value it returns.

    The script may `await wait()` for the next picture, and `await until(condition)` for the work of
    other threads of the browser: its clock stands still for them, so that it computes meanwhile.
    Errors of the page are returned as a list of texts, one of the script as its stack.
    """
    # Without a screen, Chromium asks for no new picture: a timer does.
    before = (
        "<script>window.errors=[];addEventListener('error',e=>errors.push(e.message));"
        "window.requestAnimationFrame=f=>setTimeout(()=>f(performance.now()),16);</script>"
    )
    after = (
        "<script>addEventListener('load',async()=>{let found;"
        "const wait=()=>new Promise(r=>setTimeout(r,60));"
        "const until=async f=>{while(!f()){for(let i=0;i<4e6;i++)window.spent=i;"
        "await new Promise(r=>setTimeout(r,4))}};"
        f"try{{await wait();found=await(async()=>{{{script}}})()}}catch(e){{found=String(e.stack)}}"
        "const p=document.createElement('pre');p.id='found';document.body.append(p);"
        "p.textContent=JSON.stringify(errors.length?errors:found)})</script>"
    )
    file = folder / "page.html"
    file.write_text(
        page.replace("<head>", f"<head>{before}").replace("</body>", f"{after}</body>"),
        encoding="utf-8",
    )
    text = chromium(folder, file, "--virtual-time-budget=8000", "--dump-dom",
                    "--window-size=1200,900", anchor=anchor)  # fmt: skip
    value = re.search(r'<pre id="found">(.*?)</pre>', text, re.DOTALL)
    assert value is not None, "the script in the page did not end"
    return json.loads(html.unescape(value[1]))
