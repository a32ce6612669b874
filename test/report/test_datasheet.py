# SPDX-License-Identifier: Apache-2.0
"""The measured datasheet: what stands on the page stands on paper, with where it comes from."""

import re
import subprocess

from imu_bench.cli.main import main
import numpy as np
import pytest
from scipy import signal


@pytest.fixture(scope='module')
def written(tmp_path_factory):
    """Return the folder with the datasheets of a sensor at rest, as `analyze` writes them."""
    folder = tmp_path_factory.mktemp('sheets')
    rng = np.random.default_rng(1)
    names = [f'{q}.{a}' for q in ('linear_acceleration', 'angular_velocity') for a in 'xyz']
    rows = np.empty((12_000, 7))
    rows[:, 0] = 1_700_000_000.0 + np.arange(12_000) / 100.0
    rows[:, 1:4] = rng.normal([0.0, 0.0, 9.80665], 0.02, (12_000, 3))
    # a filter of the gyroscope at 10 Hz
    white = rng.normal(0.0, 1e-3, (13_000, 3))
    rows[:, 4:] = signal.lfilter(*signal.butter(1, 0.2), white, axis=0)[1000:]
    chip = folder / 'chip.csv'
    np.savetxt(chip, rows, fmt='%.9f', delimiter=',', header=','.join(['stamp_s', *names]),
               comments='')  # fmt: skip
    sheet = folder / 'maker.yaml'
    sheet.write_text(
        'chip: {source: XY-1 rev. 3, linear_acceleration: {noise_density: 300 µg/√Hz}}'
    )
    arguments = ['--datasheet', sheet, '--sheets', folder / 'out', '--pdf']
    assert main(['analyze', *map(str, [chip, *arguments])]) == 0
    return folder


def words(page):
    shown = re.sub(r'<(script|style)\b.*?</\1>|<[^>]*>', ' ', page, flags=re.DOTALL)
    return ' '.join(shown.replace('\u00a0', ' ').split())


@pytest.mark.slow
def test_the_page_has_numbers_conditions_verdict_and_provenance(written):
    said = words((written / 'out' / 'chip.html').read_text('utf-8'))
    assert 'chip: measured datasheet' in said
    # 0.02 m/s² at 100 Hz: 288 µg/√Hz one-sided
    found = re.search(r'Noise density (\d+).*? µg/√Hz one-sided, 100\.0', said)
    assert found, said
    assert int(found[1]) == pytest.approx(288, rel=0.05)
    assert '300 as specified' in said
    assert 'Maker: XY-1 rev. 3' in said
    for row in ('White noise N', 'Bias instability B', 'Rate random walk K',
                'In-run bias stability', 'Minimum seen', 'Maximum seen'):  # fmt: skip
        assert row.lower() in said.lower()
    (width,) = re.findall(r'Bandwidth (.*?) Hz −3 dB, from the bend', said)
    values = [float(number) for number in re.findall(r'([\d.]+) (?:±|\()', width)]
    assert values == [pytest.approx(10.0, rel=0.1)] * 3
    assert 'Data measured' in said
    assert '2023-11-14' in said
    assert 'imu-bench analyze' in said


def test_the_sum_of_the_input_is_that_of_another_program(written):
    said = words((written / 'out' / 'chip.html').read_text('utf-8'))
    other = subprocess.run(
        ['sha256sum', written / 'chip.csv'], capture_output=True, text=True, check=True
    )
    assert f'SHA-256 of chip.csv {other.stdout.split()[0]}' in said


def test_paper_says_what_the_page_says(written):
    import pypdfium2

    with pypdfium2.PdfDocument(written / 'out' / 'chip.pdf') as paper:
        assert len(paper) <= 2
        size = paper[0].get_size()
        text = ' '.join(' '.join(page.get_textpage().get_text_range().split()) for page in paper)
    assert size == pytest.approx((595.3, 841.9), abs=0.5)  # points: A4 upright
    page = words((written / 'out' / 'chip.html').read_text('utf-8'))
    numbers = re.findall(r'[\d.]+ ± [\d.]+', page)
    assert len(numbers) > 5
    assert [n for n in numbers if n not in text] == []
    assert 'SHA-256 of chip.csv' in text


def test_pdf_wants_a_folder(capsys):
    assert main(['analyze', 'x.csv', '--pdf']) == 1
    assert '--sheets DIR' in capsys.readouterr().err


@pytest.fixture(scope='module')
def warmed(tmp_path_factory):
    """Return the datasheet and the CSV of a sensor that was warmed by 8 K, 0.2 mg/K."""
    folder = tmp_path_factory.mktemp('warmed')
    n = 12_000
    celsius = 25.0 + 8.0 * np.arange(n) / n
    force = np.random.default_rng(2).normal([0.0, 0.0, 9.80665], 0.02, (n, 3))
    force += 0.2e-3 * 9.80665 * (celsius[:, None] - 25.0)
    rows = np.column_stack([1_700_000_000.0 + np.arange(n) / 100.0, force, celsius])
    names = [f'linear_acceleration.{axis}' for axis in 'xyz']
    np.savetxt(folder / 'chip.csv', rows, fmt='%.9f', delimiter=',', comments='',
               header=','.join(['stamp_s', *names, 'temperature']))  # fmt: skip
    (folder / 'maker.yaml').write_text(
        'chip: {source: XY-1, linear_acceleration: {bias_per_kelvin: 0.05 mg/K}}'
    )
    arguments = ['analyze', folder / 'chip.csv', '--units', 'temperature=degC', '--sheets', folder,
                 '--json', folder / 'r.json', '--html', folder / 'r.html',
                 '--datasheet', folder / 'maker.yaml']  # fmt: skip
    assert main(list(map(str, arguments))) == 0
    return folder


def test_the_temperature_coefficient_stands_beside_that_of_the_maker(warmed, capsys):
    said = words((warmed / 'chip.html').read_text('utf-8'))
    [row] = re.findall(
        r'Temperature coefficient (.*?) mg/K of the bias, 25\.0 to 33\.0 °C 0\.0500 worse', said
    )
    values = [float(number) for number in re.findall(r'([\d.]+) (?:±|\()', row)]
    assert values == [pytest.approx(0.2, rel=0.2)] * 3
    assert 'Temperature 25.2 °C at the start, 32.8 °C at the end' in said
    page = words((warmed / 'r.html').read_text('utf-8'))
    assert 'Temperature coefficient mg/K' in page
    assert 'acceleration, temperature coefficient worse' in page
    assert main(['export', str(warmed / 'r.json'), '--to', 'csv']) == 0
    lines = [line.split(',') for line in capsys.readouterr().out.splitlines()]
    slopes = [float(line[4]) for line in lines if line[3] == 'temperature_coefficient']
    assert slopes == [pytest.approx(0.2e-3 * 9.80665, rel=0.2)] * 3


def test_what_was_seen_has_one_unit(warmed):
    """Minimum and maximum stood in mg and g, one below the other."""
    said = words((warmed / 'chip.html').read_text('utf-8'))
    rows = re.findall(r'(?:Mean, with gravity|Minimum seen|Maximum seen) .*? (µg|mg|g) ', said)
    assert len(rows) == 3
    assert len(set(rows)) == 1
