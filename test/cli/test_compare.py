# SPDX-License-Identifier: Apache-2.0
"""`imu-bench compare`: table, page and document of results against one another."""

import json
import re

import pytest


@pytest.fixture(scope='module')
def documents(write_csv, tmp_path_factory):
    from imu_bench.cli.main import main

    folder = tmp_path_factory.mktemp('runs')
    paths = []
    for name, scale in (('before', 1.0), ('after', 2.0)):
        path = folder / f'{name}.json'
        csv = write_csv('chip.csv', n=12_000, scale=scale, seed=int(scale))
        assert main(['analyze', str(csv), '--json', str(path)]) == 0
        paths.append(path)
    return paths


@pytest.mark.slow
def test_table_page_and_document(imu_bench, documents, tmp_path):
    page, document = tmp_path / 'c.html', tmp_path / 'c.json'
    code, out, err = imu_bench('compare', *documents, '--html', page, '--json', document)
    assert (code, err) == (0, '')
    assert 'chip: after against before' in out
    assert re.search(r'linear_acceleration\.x +bias', out)
    assert re.search(r'noise density .* higher', out)
    lines = json.loads(document.read_text())['lines']
    noise = [line for line in lines if line['parameter'] == 'noise_density']
    assert all(line['verdict'] == 'higher' for line in noise)
    assert all(line['ratio']['value'] == pytest.approx(2.0, rel=0.05) for line in noise)
    html = page.read_text(encoding='utf-8')
    assert html.startswith('<!DOCTYPE html>')
    assert 'after against before' in html
    assert html.count('class="plot"') == 4
    assert 'http://' not in html.partition('<script>')[0]


def test_text_from_a_result_is_escaped(imu_bench, documents, tmp_path):
    changed = json.loads(documents[0].read_text())
    changed['recordings'][0]['topic'] = '/<script>alert(1)</script>/x/imu'
    evil = tmp_path / 'evil.json'
    evil.write_text(json.dumps(changed))
    page = tmp_path / 'c.html'
    imu_bench('compare', evil, documents[1], '--html', page)
    assert '<script>alert' not in page.read_text(encoding='utf-8')


@pytest.mark.parametrize('count', [0, 1])
def test_too_few_results(imu_bench, documents, count):
    code, out, err = imu_bench('compare', *documents[:count])
    assert code == (2 if count == 0 else 1)
    assert out == ''
    if count:
        assert 'name two or more' in err


def test_a_file_that_is_no_result(imu_bench, documents, tmp_path):
    path = tmp_path / 'no.json'
    path.write_text('{}')
    code, _, err = imu_bench('compare', documents[0], path)
    assert code == 1
    assert len(err.splitlines()) == 1
    assert 'no.json' in err


def test_a_narrow_terminal_gets_every_word(imu_bench, documents, monkeypatch):
    from imu_bench.terminal import tables as table

    wide = table.console
    monkeypatch.setattr(table, 'console', lambda: wide(40))
    code, out, _ = imu_bench('compare', *documents)
    assert code == 0
    shown, _, lines = out.partition('chip: after against before')
    assert shown
    assert max(map(len, lines.splitlines())) <= 40
    assert '…' not in lines
    assert re.search(r'linear_acceleration\.x\n +bias\n', lines)
    assert re.search(r'noise density\n +\S.* higher\n', lines)
