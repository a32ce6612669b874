# SPDX-License-Identifier: Apache-2.0
"""
The walls of the house: import contracts, and what imports without ROS or hardware.

A contract that cannot fail is none: each is broken on purpose in a copy of the tree.
"""

import ast
from importlib import metadata
from pathlib import Path
import re
import shutil
import subprocess
import sys

import grimp
import pytest

ROOT = Path(__file__).resolve().parent.parent

BLOCK = """
import sys
class Wall:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in {blocked!r}:
            raise ModuleNotFoundError(f'{{name}} is walled off', name=name)
sys.meta_path.insert(0, Wall())
import importlib, pkgutil
for package in {packages!r}:
    root = importlib.import_module(package)
    for module in pkgutil.walk_packages(getattr(root, '__path__', []), package + '.'):
        importlib.import_module(module.name)
"""

ROS = ['rclpy', 'sensor_msgs', 'std_msgs', 'geometry_msgs', 'diagnostic_msgs', 'rcl_interfaces']
HARDWARE = ['smbus2', 'periphery', 'serial', 'daqhats', 'spidev']


def import_without(blocked, packages):
    script = BLOCK.format(blocked=blocked, packages=packages)
    return subprocess.run(
        [sys.executable, '-W', 'error', '-c', script],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip


def check_contracts(tree):
    return subprocess.run(
        [Path(sys.executable).with_name('lint-imports'), '--no-cache'],
        cwd=tree, capture_output=True, text=True,
    )  # fmt: skip


def test_contracts_hold():
    result = check_contracts(ROOT)
    assert result.returncode == 0, result.stdout + result.stderr


# --- every contract, broken on purpose -----------------------------------------------------
def modules_of(folder):
    """Return the modules and packages directly in a folder, dotted, the folder's own last."""
    parts = '.'.join(folder.relative_to(ROOT).parts)
    inside = sorted(
        path.stem
        for path in folder.iterdir()
        if path.stem != '__init__' and (path.suffix == '.py' or (path / '__init__.py').exists())
    )
    return [f'{parts}.{name}' for name in inside]


ROOMS = modules_of(ROOT / 'imu_bench')
BUS = modules_of(ROOT / 'imu_bench' / 'bus')
CONVERSIONS = modules_of(ROOT / 'msg_conversions')
BACKENDS = [f'imu_bench.bus.{name}' for name in ('i2c', 'spi', 'serial_port', 'daqhat', 'gpio')]
SENSORS = [
    name for name in modules_of(ROOT / 'imu_bench' / 'drivers') if not name.endswith('.driver')
]

OFFENCES = {
    'Layers point downwards only': [
        ('imu_bench.units', 'imu_bench.samples'),
        ('imu_bench.samples', 'imu_bench.metrology'),
        ('imu_bench.registers', 'imu_bench.bus'),
        ('imu_bench.bags', 'imu_bench.bus'),
        ('imu_bench.bus', 'imu_bench.simulation'),
        ('imu_bench.drivers', 'imu_bench.emulators'),
        ('imu_bench.acquisition', 'imu_bench.bench'),
        ('imu_bench.doctor', 'imu_bench.nodes'),
        ('imu_bench.nodes', 'imu_bench.cli'),
    ],
    'ROS lives in nodes and msg_conversions.building only': [
        (module, library)
        for module in ROOMS + CONVERSIONS
        if module not in ('imu_bench.nodes', 'msg_conversions.building')
        for library in ('rclpy', 'sensor_msgs', 'msg_conversions.building')
    ],
    'Hardware libraries live in the backends of bus only': [
        (module, library)
        for module in ROOMS + BUS + CONVERSIONS
        if module not in BACKENDS
        for library in ('smbus2', 'periphery', 'serial', 'daqhats')
    ],
    'msg_conversions knows nothing of the bench': [
        (module, 'imu_bench.units') for module in CONVERSIONS
    ],
    'Sensor files are independent of one another': list(
        zip(SENSORS, SENSORS[1:] + SENSORS[:1], strict=True)
    ),
    'Offline never imports the bench': [('imu_bench.offline', 'imu_bench.bench')],
}
"""By contract who imports what it must not."""


def file_of(tree, module):
    path = tree.joinpath(*module.split('.'))
    return path / '__init__.py' if path.is_dir() else path.with_suffix('.py')


def add_imports(tree, imports):
    for module, imported in imports:
        with file_of(tree, module).open('a', encoding='utf-8') as file:
            file.write(f'\nimport {imported}\n')


def copied(folder):
    """Return a folder with a copy of what the contracts are about."""
    for package in ('imu_bench', 'msg_conversions'):
        ignored = shutil.ignore_patterns('__pycache__')
        shutil.copytree(ROOT / package, folder / package, ignore=ignored)
    shutil.copy(ROOT / 'pyproject.toml', folder)
    return folder


@pytest.fixture
def tree(tmp_path):
    return copied(tmp_path)


@pytest.fixture(scope='module')
def offended(tmp_path_factory):
    """Give what is said of a tree in which every contract is broken, in one run."""
    tree = copied(tmp_path_factory.mktemp('offended'))
    for imports in OFFENCES.values():
        add_imports(tree, imports)
    return check_contracts(tree)


def reports(result):
    """Return by contract what is said of those that are broken, on one line each."""
    names = '|'.join(map(re.escape, OFFENCES))
    parts = re.split(rf'^({names})\n-+$', result.stdout, flags=re.MULTILINE)[1:]
    texts = (re.sub(r'\s+', ' ', text) for text in parts[1::2])
    return dict(zip(parts[::2], texts, strict=True))


def verdicts(result):
    """Return by contract whether it is kept."""
    lines = re.findall(r'^(.+) (KEPT|BROKEN)\b', result.stdout, re.MULTILINE)
    return {name: verdict == 'KEPT' for name, verdict in lines}


def test_every_contract_is_broken_below():
    text = (
        (ROOT / 'pyproject.toml').read_text(encoding='utf-8').partition('[tool.importlinter]')[2]
    )
    assert re.findall('^name = "(.+)"$', text, re.MULTILINE) == list(OFFENCES)


@pytest.mark.slow
@pytest.mark.parametrize('name', OFFENCES)
def test_a_contract_can_fail(offended, name):
    assert offended.returncode == 1
    assert not verdicts(offended)[name]
    report = reports(offended)[name]  # of this contract alone
    missed = [
        (module, imported)
        for module, imported in OFFENCES[name]
        if f'{module} -> {imported} ' not in report
    ]
    assert not missed


@pytest.mark.slow
def test_a_new_room_needs_a_layer(tree):
    (tree / 'imu_bench' / 'attic.py').write_text('', encoding='utf-8')
    result = check_contracts(tree)
    assert result.returncode == 1
    assert not verdicts(result)['Layers point downwards only']
    assert 'attic' in result.stdout


LIBRARIES_OF_SOME = (
    'sys_platform',
    *(f"extra == '{extra}'" for extra in ('ros', 'ros-kilted', 'daqhats', 'test')),
)


def plain(requirement):
    """Return the name of a requirement, as all spell it alike."""
    return re.sub('[-_.]+', '-', re.match(r'[\w.-]+', requirement)[0]).lower()


def required(distribution):
    try:
        return metadata.requires(distribution) or []
    except metadata.PackageNotFoundError:  # not needed here, such as for an older Python
        return []


@pytest.mark.slow
def test_what_not_everybody_has_is_protected():
    """Libraries for Linux alone are hardware; whatever nobody declares comes with ROS."""
    declared = [
        requirement
        for requirement in required('imu_bench')
        if not any(some in requirement.replace('"', "'") for some in LIBRARIES_OF_SOME)
    ]
    for_everybody = set(map(plain, declared))
    # what they need themselves comes with them
    for library in list(for_everybody):
        for_everybody.update(plain(text) for text in required(library) if 'extra ==' not in text)
    distributions = metadata.packages_distributions()
    graph = grimp.build_graph('imu_bench', 'msg_conversions', include_external_packages=True)
    text = (ROOT / 'pyproject.toml').read_text(encoding='utf-8')
    protected = re.findall(
        r'"(.+?)"', ' '.join(re.findall(r'protected_modules = \[(.+?)\]', text, re.DOTALL))
    )
    assert {'rclpy', 'smbus2'} <= set(protected)
    unprotected = {
        name
        for name in graph.modules
        if name.partition('.')[0] not in ('imu_bench', 'msg_conversions')
        and name not in {*sys.stdlib_module_names, 'compression'}  # part of Python 3.14
        and name not in protected
        and not for_everybody & set(map(plain, distributions.get(name, ())))
    }
    assert not unprotected


# --- imports by name, which the contracts do not see ----------------------------------------
LOADERS = {
    'imu_bench/__init__.py', 'imu_bench/bench.py', 'imu_bench/cli/main.py',
    'imu_bench/terminal/working.py',
    'imu_bench/drivers/__init__.py', 'imu_bench/emulators/__init__.py',
    'imu_bench/nodes/discovery.py', 'imu_bench/nodes/spinning.py',
    'imu_bench/offline/__init__.py', 'imu_bench/offline/plans/__init__.py',
}  # fmt: skip
"""Files that may import by name; what they name has to hold the contracts as well."""


OURS = r'(imu_bench|msg_conversions)(\.\w+)+$'


def imports_by_name(tree):
    """Return by file what those import that import by name: modules of ours, and arguments."""
    found = {}
    for path in sorted([*tree.glob('imu_bench/**/*.py'), *tree.glob('msg_conversions/**/*.py')]):
        text = path.read_text(encoding='utf-8')
        if 'import_module' not in text and '__import__' not in text:
            continue
        nodes = list(ast.walk(ast.parse(text)))
        loading = [
            node
            for node in nodes
            if (isinstance(node, ast.Name) and node.id in ('import_module', '__import__'))
            or (isinstance(node, ast.Attribute) and node.attr == 'import_module')
        ]
        if loading:
            ours = {text for text in texts(nodes) if re.match(OURS, text)}
            calls = [n for n in nodes if isinstance(n, ast.Call) and n.func in loading]
            others = texts(argument for call in calls for argument in call.args)
            found[str(path.relative_to(tree))] = ours | others
    return found


def texts(nodes):
    constants = [node.value for node in nodes if isinstance(node, ast.Constant)]
    return {value for value in constants if isinstance(value, str)}


def test_only_these_import_by_name():
    assert set(imports_by_name(ROOT)) == LOADERS


def write_out(tree):
    """Write imports by name as imports that the contracts see."""
    for path, names in imports_by_name(tree).items():
        module = path.removesuffix('.py').removesuffix('/__init__').replace('/', '.')
        add_imports(tree, [(module, name) for name in names])


@pytest.mark.slow
def test_imports_by_name_hold_the_contracts(tree):
    named = imports_by_name(tree)
    assert 'rclpy' in named['imu_bench/nodes/spinning.py']
    assert 'imu_bench.terminal.tables' in named['imu_bench/terminal/working.py']
    write_out(tree)
    result = check_contracts(tree)
    assert result.returncode == 0, result.stdout


BY_NAME = {
    'Hardware libraries live in the backends of bus only': ('imu_bench.drivers', 'smbus2'),
    'ROS lives in nodes and msg_conversions.building only': ('imu_bench.bench', 'rclpy'),
    'Layers point downwards only': ('imu_bench.emulators', 'imu_bench.cli.main'),
}
"""By contract an import that the contracts do not see."""


@pytest.mark.slow
def test_an_import_by_name_can_break_a_contract(tree):
    for module, imported in BY_NAME.values():
        with file_of(tree, module).open('a', encoding='utf-8') as file:
            file.write(f'\n\ndef late():\n    return import_module({imported!r})\n')
    assert all(verdicts(check_contracts(tree)).values())
    write_out(tree)
    found = reports(check_contracts(tree))
    for contract, (module, imported) in BY_NAME.items():
        assert f'{module} -> {imported.partition(".")[0]}' in found[contract]


# --- imports without ROS or hardware --------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize('package', ['imu_bench.offline', 'imu_bench.metrology', 'imu_bench.cli'])
def test_offline_side_imports_on_a_laptop(package):
    result = import_without(ROS + HARDWARE, [package])
    assert result.returncode == 0, result.stderr


@pytest.mark.slow
def test_drivers_and_emulators_import_without_hardware_libraries():
    packages = ['imu_bench.drivers', 'imu_bench.emulators', 'imu_bench.simulation']
    result = import_without(ROS + HARDWARE, packages)
    assert result.returncode == 0, result.stderr


def test_the_wall_is_real():
    result = import_without(['numpy'], ['imu_bench.metrology.curve'])
    assert 'numpy is walled off' in result.stderr
