"""The colours of pages, figures and scenes: one table, from which the style sheet is written."""

from __future__ import annotations

# By name: on a light page, in figures and in scenes; on a dark page.
COLOURS = {
    "page": ("#f6f7f8", "#121417"),
    "card": ("#ffffff", "#1a1d21"),
    "ink": ("#1a1d21", "#e8eaed"),
    "soft": ("#5c6470", "#9aa3ae"),
    "line": ("#e1e4e8", "#2c3137"),
    "glass": ("#ffffffd9", "#1a1d21d9"),
    "stage-top": ("#f4f6f8", "#2a2f36"),
    "stage-bottom": ("#dde2e7", "#1b1f24"),
    "accent": ("#0072b2", "#56b4e9"),
    "good": ("#17794b", "#6fd3a2"),
    "good-back": ("#e2f3ea", "#17352a"),
    "bad": ("#b3261e", "#ff9b92"),
    "bad-back": ("#fbe6e4", "#40201e"),
    # What is drawn of a motion
    "base": ("#0072b2", "#56b4e9"),
    "tip": ("#d55e00", "#f5873b"),
    "desired": ("#6b7480", "#9aa3ae"),
    "ghost": ("#3fa39a", "#3fa39a"),
    "obstacles-base": ("#b0325f", "#f283a8"),
    "obstacles-tip": ("#9a6a00", "#e0b04a"),
    "loads": ("#8a5cd1", "#8a5cd1"),
    "zmp": ("#2a9d5c", "#2a9d5c"),
    "idle": ("#d5d9de", "#d5d9de"),  # of efforts: none, half of the limit, all of it
    "mild": ("#f2b705", "#f2b705"),
    "full": ("#d7191c", "#d7191c"),
    "hatch": ("#8b96a4", "#8b96a4"),  # of what stands in for a missing mesh
    "hatch-back": ("#f0f1f4", "#f0f1f4"),
    "grid": ("#808890", "#808890"),
    # Marks on a robot
    "x": ("#c42d28", "#ff8f88"),
    "y": ("#1c7a24", "#7fd389"),
    "z": ("#2364cf", "#8db8ff"),
    "mass": ("#e8a33d", "#e8a33d"),
    "whole-mass": ("#6b3fa0", "#6b3fa0"),
    "roller": ("#cc4b9b", "#cc4b9b"),
    "point": ("#009e73", "#009e73"),
    # Verdicts of studies
    "lost": ("#b0b7c0", "#b0b7c0"),
    "settled-early": ("#0b6e4f", "#0b6e4f"),
    "settled-late": ("#e9f2c4", "#e9f2c4"),
    "failed": ("#c8324a", "#c8324a"),
    "refused": ("#d5d9df", "#d5d9df"),
    "undecided": ("#f0a202", "#f0a202"),
    "pass": ("#d7efe0", "#d7efe0"),
    "degrade": ("#e8a02c", "#e8a02c"),
    "fail": ("#8f1d2c", "#8f1d2c"),
}
# Of a chart's lines, the first seven after Okabe and Ito; told apart by the colour-blind.
LINES = (
    ("#0072b2", "#56b4e9"),
    ("#d55e00", "#f5873b"),
    ("#009e73", "#35c492"),
    ("#c2559a", "#e88fc6"),
    ("#3aa0d8", "#9bd6f7"),
    ("#c98a00", "#f0c24b"),
    ("#7a5c2e", "#c9a878"),
    ("#6a4fc4", "#ab98f5"),
    ("#7f9a1c", "#b6cf55"),
    ("#b02a3c", "#f0727f"),
    ("#4a5a6a", "#b4c0cc"),
    ("#1f7f8c", "#5fc9d6"),
)
# From least to most: Cividis, told apart without red or green, and by its lightness alone.
RAMP = ("#00224e", "#233e6c", "#4f576c", "#707173", "#948e77", "#bda969", "#e5c953", "#fee838")


def light(name: str) -> str:
    """Return a colour on a light ground, as figures have it."""
    return COLOURS[name][0]


def number_of(name: str) -> int:
    """Return that colour as 0xRRGGBB, as scenes have it."""
    return int(light(name)[1:7], 16)


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue (0 to 255) of a colour ``#rrggbb``."""
    red, green, blue = bytes.fromhex(colour[1:7])
    return red, green, blue


def mixed(first: str, second: str, share: float) -> str:
    """Return the colour at a share (0 to 1) of the way from one colour to another."""
    pairs = zip(rgb(first), rgb(second), strict=True)
    return "#" + bytes(round(a + share * (b - a)) for a, b in pairs).hex()


def style_sheet(dark: bool = True) -> str:
    """Return the colours as variables of a style sheet.

    Args:
        dark: Whether the page is dark where its reader's other pages are.
    """
    lines = {f"c{k}": pair for k, pair in enumerate(LINES)}
    sheets = []
    for k, scheme in enumerate(("light", "dark")):
        variables = "".join(f" --{name}: {pair[k]};" for name, pair in {**COLOURS, **lines}.items())
        sheets.append(f":root {{ color-scheme: {scheme};{variables} }}\n")
    return (
        f"{sheets[0]}@media (prefers-color-scheme: dark) {{ {sheets[1]} }}\n" if dark else sheets[0]
    )
