# SPDX-License-Identifier: Apache-2.0
"""
How large the house is: files, lines of code and of docstrings, who imports whom.

`python test/house.py [PACKAGE]` prints the numbers of the whole package, or of a part of it such
as `offline`; `python test/house.py --diagram` draws who imports whom, for docs/architecture.md.
"""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from pathlib import Path
import sys
import tokenize

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ('imu_bench', 'msg_conversions')
SAME = 6
"""Lines in a row that count as written twice."""

_SILENT = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip


def files(part: str = '') -> dict[str, Path]:
    """Return the files of the packages by module name; only those of a part of imu_bench."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob('*.py')):
            name = '.'.join(path.relative_to(ROOT).with_suffix('').parts)
            found[name.removesuffix('.__init__')] = path
    begin = f'imu_bench.{part}' if part else ''
    return {n: p for n, p in found.items() if n == begin or n.startswith(begin and f'{begin}.')}


def lines(path: Path) -> tuple[int, int]:
    """Return the lines of code, without blanks, comments and docstrings, and of docstrings."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    said: set[int] = set()
    for node in ast.walk(tree):
        body = getattr(node, 'body', None)
        for statement in body if isinstance(body, list) else ():
            # a string that stands alone is a docstring, also below a constant
            value = statement.value if isinstance(statement, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                said |= set(range(statement.lineno, (statement.end_lineno or 0) + 1))
    code: set[int] = set()
    with path.open('rb') as file:
        for token in tokenize.tokenize(file.readline):
            if token.type not in _SILENT:
                code |= set(range(token.start[0], token.end[0] + 1))
    return len(code - said), len(said)


def imports(modules: dict[str, Path]) -> dict[str, set[str]]:
    """Return which modules each one imports, also inside functions; packages hand names on."""
    return {name: _imported(name, path, modules) for name, path in modules.items()}


def _imported(name: str, path: Path, modules: dict[str, Path]) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f'{node.module}.{alias.name}'
                found.add(inner if inner in modules else node.module)
    return (found & modules.keys()) - {name}


def imported_by_one(graph: dict[str, set[str]]) -> list[str]:
    """Return the modules that exactly one other imports."""
    users = Counter(target for targets in graph.values() for target in targets)
    return sorted(name for name in graph if users[name] == 1)


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of modules that import one another in a circle."""
    reach: dict[str, set[str]] = {}
    for name in graph:
        seen: set[str] = set()
        waiting = [name]
        while waiting:
            new = graph[waiting.pop()] - seen
            seen |= new
            waiting += new
        reach[name] = seen
    groups = {tuple(sorted(o for o in reach[n] if n in reach[o])) for n in graph if n in reach[n]}
    return sorted(map(list, groups))


def written_twice(modules: dict[str, Path]) -> list[tuple[str, str]]:
    """Return the pairs of modules that share several lines in a row; imports do not count."""
    places: dict[tuple[str, ...], set[str]] = defaultdict(set)
    for name, path in modules.items():
        text = path.read_text(encoding='utf-8')
        imported = _import_lines(text)
        shown = [
            line.strip()
            for number, line in enumerate(text.splitlines(), 1)
            if line.strip() and number not in imported
        ]
        for at in range(len(shown) - SAME + 1):
            places[tuple(shown[at : at + SAME])].add(name)
    pairs = {
        (one, other)
        for names in places.values()
        for one in names
        for other in names
        if one < other
    }
    return sorted(pairs)


def _import_lines(text: str) -> set[int]:
    return {
        number
        for node in ast.walk(ast.parse(text))
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for number in range(node.lineno, (node.end_lineno or 0) + 1)
    }


def numbers(part: str = '') -> dict[str, int]:
    """Return all numbers, of the packages or of a part of imu_bench."""
    modules = files(part)
    counted = [lines(path) for path in modules.values()]
    every = imports(files())
    graph = {name: targets & modules.keys() for name, targets in every.items() if name in modules}
    return {
        'files': len(modules),
        'lines of code': sum(code for code, _ in counted),
        'lines of docstrings': sum(said for _, said in counted),
        'imported by one other': len([n for n in imported_by_one(every) if n in modules]),
        'circles': len(circles(graph)),
        f'pairs of files with {SAME} equal lines': len(written_twice(modules)),
    }


def diagram() -> str:
    """Return the packages of imu_bench in Mermaid; arrows that others imply are left out."""
    uses: dict[str, set[str]] = defaultdict(set)
    for name, targets in imports(files('')).items():
        room, others = _room(name), {_room(target) for target in targets}
        uses[room] |= others - {room, 'imu_bench'}
    uses.pop('imu_bench', None)
    reach: dict[str, set[str]] = {}

    def reached(room: str) -> set[str]:
        if room not in reach:
            reach[room] = uses[room].union(*(reached(other) for other in uses[room]))
        return reach[room]

    lines = ['flowchart TD']
    for room in sorted(uses):
        far = set().union(*(reached(other) for other in uses[room]))
        lines += [f'    {room} --> {other}' for other in sorted(uses[room] - far)]
    return '\n'.join(lines)


def _room(module: str) -> str:
    parts = module.split('.')
    return parts[0] if parts[0] != 'imu_bench' or len(parts) == 1 else parts[1]


if __name__ == '__main__':
    if '--diagram' in sys.argv:
        print(diagram())
        sys.exit()
    for title, number in numbers(*sys.argv[1:2]).items():
        print(f'{number:>8} {title}')
