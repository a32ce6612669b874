# SPDX-License-Identifier: Apache-2.0
"""Package description for pip and colcon (ament_python)."""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'imu_bench'
HERE = Path(__file__).resolve().parent
# a sensor's node exists because its driver file exists
SENSORS = sorted(
    path.stem for path in (HERE / NAME / 'drivers').glob('*.py') if path.stem != '__init__'
)


DOCS = ['sphinx>=7.2', 'myst-parser>=2', 'numpydoc>=1.6', 'sphinx-rtd-theme>=2', 'matplotlib>=3.8']


def share(pattern: str) -> list[tuple[str, list[str]]]:
    """Return data_files that mirror the matching files below share/imu_bench."""
    folders: dict[str, list[str]] = {}
    for path in sorted(glob(pattern, root_dir=HERE, recursive=True)):
        if (HERE / path).is_file():
            folders.setdefault(f'share/{NAME}/{Path(path).parent}', []).append(path)
    return list(folders.items())


setup(
    name=NAME,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*', 'benchmarks']),
    package_data={
        NAME: ['py.typed', '**/*.html', '**/*.css', '**/*.js', '**/*.jinja'],
        'msg_conversions': ['py.typed'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *share('config/**/*'),
        *share('launch/*_launch.py'),
        ('share/man/man1', ['docs/man/imu-bench.1']),
    ],
    python_requires='>=3.10',
    install_requires=[
        'setuptools',
        'numpy>=1.26',
        'scipy>=1.11',
        'PyYAML>=6.0',
        'rosbags>=0.11',
        'lz4>=4',
        'backports.zstd>=1; python_version < "3.14"',
        'bokeh>=3.4',
        'Jinja2>=3.1',
        'rich>=13',
        'argcomplete>=3.1',
        'smbus2>=0.4; sys_platform == "linux"',
        'pyserial>=3.5; sys_platform == "linux"',
        'python-periphery>=2.4; sys_platform == "linux"',
    ],
    extras_require={
        'ros': ['ros-jazzy-rclpy[fastrtps]==7.1.6', 'ros-jazzy-common-interfaces==5.3.6'],
        'ros-kilted': ['ros-kilted-rclpy[fastrtps]==9.1.2', 'ros-kilted-common-interfaces==5.5.1'],
        'docs': DOCS,
        'figures': ['matplotlib>=3.8'],
        'notebook': ['pandas>=2.0', 'xarray>=2023.6', 'matplotlib>=3.8'],
        'fast': ['isal>=1.5'],
        'cluster': ['distributed>=2024.1'],
        'daqhats': ['daqhats>=1.4'],  # MCC 172; its C library comes from the maker
        'test': [
            'pytest>=7.4',
            'pytest-timeout>=2.2',
            'pytest-xdist>=3.5',
            'hypothesis>=6.90',
            'ruff>=0.12',
            'mypy>=1.16',
            'import-linter>=2.5',
            'types-PyYAML',
            'allantools==2024.6',
            'distributed>=2024.1',
            'mcap-ros2-support>=0.5',
            'pandas>=2.0',
            'xarray>=2023.6',
            'cyclonedds==11.0.1',
            'colcon-common-extensions',
            'pypdfium2>=4',
            # colcon builds ament_python packages with setup.py develop; 70.1 builds wheels itself
            'setuptools>=70.1,<80',
            *DOCS,
        ],
    },
    zip_safe=True,
    author='imu_bench maintainers',
    maintainer='imu_bench maintainers',
    maintainer_email='maintainers@imu-bench.invalid',
    description='A test bench for several IMUs: nodes, emulators, noise metrology, reports.',
    long_description=(HERE / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'imu-bench = imu_bench.cli.main:main',
            'sensor_node = imu_bench.nodes.sensor_node:main',
            'bench_node = imu_bench.nodes.bench_node:main',
            'analysis_node = imu_bench.nodes.analysis_node:main',
            'recorder_node = imu_bench.nodes.recorder_node:main',
            *(f'{sensor}_node = imu_bench.nodes.sensor_node:main' for sensor in SENSORS),
        ],
    },
)
