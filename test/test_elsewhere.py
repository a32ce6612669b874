# SPDX-License-Identifier: Apache-2.0
"""What runs on other machines, CI and containers, names files, verbs and options that exist."""

from pathlib import Path
import re
import shlex
import subprocess

from imu_bench.cli.main import build_parser
import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
IMAGES = sorted((ROOT / 'docker').glob('*.Dockerfile'))
WORKFLOWS = sorted((ROOT / '.github' / 'workflows').glob('*.yml'))
WORDS_OF_A_PATH = re.compile(r'^(?:\./|src/imu_bench/)?((?:test|docker|docs|\.ci)(?:/[\w.-]+)*)$')


def steps(workflow):
    """Yield the job and the script of every step that runs one."""
    jobs = yaml.safe_load(workflow.read_text('utf-8'))['jobs']
    for name, job in jobs.items():
        for step in job['steps']:
            assert ('run' in step) != ('uses' in step)
            if 'run' in step:
                yield name, step['run']


def lines_of(image):
    """Return instruction and words of every line of a Dockerfile."""
    text = image.read_text('utf-8').replace('\\\n', ' ')
    return [line.split(None, 1) for line in text.splitlines() if re.match('[A-Z]+ ', line)]


SCRIPTS = [
    *(pytest.param(s, id=f'{w.stem}: {name} {n}')
      for w in WORKFLOWS for n, (name, s) in enumerate(steps(w))),
    *(pytest.param(rest, id=f'{image.stem} {n}')
      for image in IMAGES for n, (what, rest) in enumerate(lines_of(image)) if what == 'RUN'),
    *(pytest.param('\n'.join(re.findall(r'^#   (docker .*)$', image.read_text('utf-8'), re.M)),
                   id=f'{image.stem}: how') for image in IMAGES),
]  # fmt: skip


@pytest.mark.parametrize('script', SCRIPTS)
def test_scripts_are_right_as_far_as_they_can_be_read(script):
    script = re.sub(r'\$\{\{.*?\}\}', 'x', script)  # what the service puts in
    checked = subprocess.run(
        ['bash', '-n'], input=script, capture_output=True, text=True, check=False
    )
    assert (checked.returncode, checked.stderr) == (0, '')
    for line in re.split(r'\n|&&|;', script):
        words = shlex.split(line, comments=True)
        for word in words:
            named = WORDS_OF_A_PATH.match(word)
            assert not named or (ROOT / named[1]).exists(), word
        if words[:2] == ['docker', 'run'] or 'imu-bench' in words:
            verb = next(k for k, w in enumerate(words) if w in {'imu-bench', 'imu_bench_offline',
                                                                'launch'})  # fmt: skip
            if words[verb] != 'launch':
                build_parser().parse_args(words[verb + 1 :])
        if words[:1] == ['./run']:
            assert re.search(rf'^{words[1]}\)$', (ROOT / 'run').read_text('utf-8'), re.M)


@pytest.mark.parametrize('image', IMAGES, ids=lambda path: path.stem)
def test_what_an_image_copies_is_there(image):
    lines = lines_of(image)
    assert lines[0][0] == 'FROM'
    for what, rest in lines:
        if what == 'COPY' and '--from' not in rest:
            for source in rest.split()[:-1]:
                assert (ROOT / source).exists()
        if what == 'ENTRYPOINT':
            for path in re.findall(r'/ws/src/imu_bench/([\w./]+)', rest):
                assert (ROOT / path).stat().st_mode & 0o111


def test_ci_builds_on_both_distributions_and_every_python():
    jobs = yaml.safe_load((ROOT / '.github/workflows/ci.yml').read_text('utf-8'))['jobs']
    assert {'jazzy', 'lyrical'} <= set(jobs['workspace']['strategy']['matrix']['distro'])
    setup = (ROOT / 'setup.py').read_text('utf-8')
    least = re.search(r"python_requires='>=3\.(\d+)'", setup)[1]
    pythons = [f'3.{minor}' for minor in range(int(least), 15)]
    assert jobs['offline']['strategy']['matrix']['python'] == pythons
    for job in jobs.values():
        assert {'runs-on', 'steps'} <= set(job)
