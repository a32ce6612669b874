# SPDX-License-Identifier: Apache-2.0
"""What the pages say is there is there: links, files, verbs and options of every command."""

from importlib import util
from pathlib import Path
import re
import shlex
import shutil

from imu_bench.cli.main import build_parser, main
from msg_conversions.quantities import AXES, IMU_QUANTITIES
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = [p for p in (ROOT / 'docs').rglob('*.md') if not {'generated', '_build'} & set(p.parts)]
PAGES = sorted([ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *DOCS])
SPEC = util.spec_from_file_location('reference', ROOT / 'docs' / 'reference.py')
reference = util.module_from_spec(SPEC)
SPEC.loader.exec_module(reference)
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
        if page.parent != ROOT:  # the site has its own pages, and any file as a download
            inside = target.is_relative_to(ROOT / 'docs')
            assert inside or (target.is_file() and target.suffix != '.md'), link
        assert not anchor or anchor in anchors(target), link


def test_the_files_of_the_table_of_changes_are_there():
    page = (ROOT / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    table = page.partition('## Where to change what')[2]
    named = [n for n in re.findall(r'`([\w/.]+)`', table) if '<' not in n]
    assert len(named) > 15
    for each in named:
        places = ROOT / 'imu_bench' / each, ROOT / each
        assert any(place.exists() for place in places), each


def blocks(page, language):
    """Return the text of every block of a language, lines joined where they go on."""
    text = page.read_text(encoding='utf-8').replace('\\\n', ' ')
    return re.findall(rf'```{language}\n(.*?)```', text, re.DOTALL)


def words_of(line):
    """Return the words of a command, without what the shell does with it."""
    words = shlex.split(line, comments=True)
    end = next((k for k, word in enumerate(words) if word in ('|', ';', '&&', '>')), len(words))
    return words[:end]


def commands():
    """Yield page and words of every command of the verbs, however it is started."""
    start = r'(?:\./run exec |ros2 run imu_bench )?imu-bench (.*)'
    for page in PAGES:
        for block in blocks(page, 'sh'):
            for line in block.splitlines():
                if match := re.match(start, line):
                    label = f'{page.stem}: {match[1][:60]}'
                    yield pytest.param(page, words_of(match[1]), id=label)


@pytest.mark.parametrize(('page', 'words'), list(commands()))
def test_commands_have_verbs_and_options_that_exist(page, words):
    build_parser().parse_args(words)


def test_other_commands_start_what_is_there():
    setup = (ROOT / 'setup.py').read_text('utf-8')
    nodes = {path.stem for path in (ROOT / 'imu_bench' / 'drivers').glob('*.py')}
    programs = {*re.findall(r"'([\w-]+) = imu_bench", setup), *(f'{n}_node' for n in nodes)}
    launch = (ROOT / 'launch' / 'bench_launch.py').read_text('utf-8')
    verbs = re.findall(r'^(\w+)\)$', (ROOT / 'run').read_text('utf-8'), re.MULTILINE)
    seen = []
    for page in PAGES:
        for line in '\n'.join(blocks(page, 'sh')).splitlines():
            words = words_of(line)
            if words[:3] == ['ros2', 'run', 'imu_bench']:
                assert words[3] in programs, line
            elif words[:3] == ['ros2', 'launch', 'imu_bench']:
                assert (ROOT / 'launch' / words[3]).is_file()
                for argument in words[4:]:
                    assert f"'{argument.partition(':=')[0]}'" in launch, line
            elif words[:1] == ['./run']:
                assert words[1] in verbs, line
            elif words[:1] in (['python'], ['python3']) and words[1] != '-m':
                assert (ROOT / words[1]).is_file(), line
            else:
                continue
            seen.append(line)
    assert len(seen) > 8


def shortened(words):
    """Return a command whose times are so short that a test can wait for it."""
    long = re.compile(r'^\d+(h|min|s)$')
    after = dict(zip(words[1:], words, strict=False))
    return [
        ('2s' if words[0] == 'record' else '6s') if after.get(w) == '--duration' and long.match(w)
        else w for w in words
    ]  # fmt: skip


@pytest.mark.slow
def test_the_first_hour_runs_as_it_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = ROOT / 'docs' / 'tutorial.md'
    text = page.read_text('utf-8')
    ran = 0
    for language, block in re.findall(r'```(sh|yaml)\n(.*?)```', text, re.DOTALL):
        if language == 'yaml':
            name, _, rest = block.removeprefix('# ').partition('\n')
            (tmp_path / name).write_text(rest.replace('20 s', '6 s'), encoding='utf-8')
            continue
        for line in block.splitlines():
            program, *words = words_of(line)
            assert program == 'imu-bench'
            code = main(shortened(words))
            assert code == 0, capsys.readouterr().err
            ran += 1
    assert ran >= 8
    made = 'night.html', 'night.json', 'campaign/index.html'
    assert [name for name in made if not (tmp_path / name).is_file()] == []


ELSEWHERE = re.compile(
    r'^(demo|record|doctor)|--scheduler|_hardware|--recorded'  # sensors, a cluster, minutes
    # recordings that others made: those of the tests of each plan
    r'|ferraris|imu\?\.log|imu0\.log|skyscrapper|bearing|old_ros1|Accelerometer\.csv|--datasheet'
    r'|BAG|monday/|ride_up|analyze first'
)
"""Commands that are read only: what they need is not in an empty folder."""


def stand_ins(folder):
    """Write recordings and results under the names that the pages use for the reader's own."""
    rng = np.random.default_rng(5)
    n = 6000
    level = [0.0, 0.0, 9.80665]
    measured = np.hstack([rng.normal(level, 0.02, (n, 3)), rng.normal(0.0, 1e-3, (n, 3))])
    units = [9.80665] * 3 + [np.pi / 180.0] * 3
    np.savetxt(folder / 'log.csv', measured / units, delimiter=',', fmt='%.9g',
               header='ax,ay,az,gx,gy,gz', comments='')  # fmt: skip
    heads = [f'{quantity.name}.{axis}' for quantity in IMU_QUANTITIES for axis in AXES]
    rows = np.column_stack([np.arange(n) / 100.0, measured])
    header = ','.join(['stamp_s', *heads])
    (folder / 'imu').mkdir()
    native = folder / 'imu' / 'data_raw.csv'
    np.savetxt(native, rows, delimiter=',', header=header, comments='')
    for words in (
        f'import {native} -o my_bag',
        f'import {native} -o nights/first',
        f'import {native} -o ride_up',
        f'analyze {native} --json results.json',
        f'analyze {native} --json monday.json',
        f'analyze {native} --json friday.json',
    ):
        assert main([*words.split(), '--quiet']) == 0
    (mcap,) = (folder / 'my_bag').glob('*.mcap')
    shutil.copy(mcap, folder / 'night.mcap')
    shutil.copytree(folder / 'my_bag', folder / 'RECORDING')


@pytest.mark.thorough
@pytest.mark.parametrize('page', PAGES, ids=name)
def test_every_command_runs_on_recordings_that_stand_in(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'nights').mkdir()
    stand_ins(tmp_path)
    for given in commands():
        of, words = given.values
        line = shlex.join(words)
        if of != page or page.stem == 'tutorial' or ELSEWHERE.search(line):
            continue
        into = tmp_path / words[words.index('-o') + 1] if '-o' in words else None
        if into is not None and words[0] != 'export' and into.is_dir():
            shutil.rmtree(into)
        more = ['--short'] if words[0] == 'campaign' else []
        found = [str(p) for w in words if '*' in w for p in sorted(tmp_path.glob(w))]
        words = [w for w in words if '*' not in w] + found
        if '/imu/data_raw' in words:  # the reader's own; those that stand in have one topic
            at = words.index('--topic')
            del words[at : at + 2]
        assert main([*shortened(words), *more]) == 0, f'{line}: {capsys.readouterr().err}'


def test_the_site_has_every_page():
    listed = []
    for index in (ROOT / 'docs').rglob('index.rst'):
        for entry in re.findall(r'^   ([\w/*]+)$', index.read_text('utf-8'), re.MULTILINE):
            if entry.startswith('generated/'):
                assert entry.partition('/')[2] in reference.MADE
            else:
                found = sorted(index.parent.glob(f'{entry}.*'))
                assert found, entry
                listed += found
    assert {p for p in DOCS if p.name != 'README.md'} <= set(listed)
