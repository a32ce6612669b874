# SPDX-License-Identifier: Apache-2.0
"""What the pages say is there is there: links, files, verbs and options of every command."""

from pathlib import Path
import re
import shlex

from imu_bench.cli.main import build_parser
import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *(ROOT / 'docs').rglob('*.md')])
LINK = re.compile(r'\[[^\]]*\]\(([^)\s]+)\)')


def name(path):
    return str(path.relative_to(ROOT))


def anchors(page):
    """Return the anchors of the headings of a page, as the usual hosts make them."""
    headings = re.findall(r'^#+ (.*)$', page.read_text(encoding='utf-8'), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', h.lower()).replace(' ', '-') for h in headings}


@pytest.mark.parametrize('page', PAGES, ids=name)
def test_links_lead_somewhere(page):
    for link in LINK.findall(page.read_text(encoding='utf-8')):
        if link.startswith(('http:', 'https:')):
            continue
        file, _, anchor = link.partition('#')
        target = (page.parent / file).resolve() if file else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_the_files_of_the_table_of_changes_are_there():
    page = (ROOT / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    table = page.partition('## Where to change what')[2]
    named = [n for n in re.findall(r'`([\w/.]+)`', table) if '<' not in n]
    assert len(named) > 15
    for each in named:
        places = ROOT / 'imu_bench' / each, ROOT / each
        assert any(place.exists() for place in places), each


def commands():
    for page in PAGES:
        text = page.read_text(encoding='utf-8').replace('\\\n', ' ')
        for block in re.findall(r'```sh\n(.*?)```', text, re.DOTALL):
            for line in block.splitlines():
                match = re.match(r'(?:\./run exec )?imu-bench (.*)', line)
                if match:
                    yield pytest.param(match[1], id=f'{page.stem}: {match[1][:60]}')


@pytest.mark.parametrize('command', list(commands()))
def test_commands_have_verbs_and_options_that_exist(command):
    words = shlex.split(command, comments=True)
    end = next((k for k, word in enumerate(words) if word in ('|', ';', '&&', '>')), len(words))
    build_parser().parse_args(words[:end])
