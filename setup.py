"""cube_sim for colcon (ament_python) and for pip: the same files in either prefix."""

from pathlib import Path

from setuptools import find_packages, setup

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:  # setuptools before 70.1, such as Ubuntu 24.04's: colcon builds no wheel
    bdist_wheel = None

PACKAGE = 'cube_sim'

EXECUTABLES = {
    'cube_bag': 'cube_sim.bag.main:main',
    'cube_sim_game': 'cube_sim.web.game:main',
    'sim_node': 'cube_sim.node.main:main',
    'teleop_key': 'cube_sim.teleop.main:main',
    'web_view': 'cube_sim.web.main:main',
}

# ros2 run looks in lib/cube_sim; pip installs into bin, naming the right interpreter there.
LAUNCHER = """#!/bin/sh
exec "$(dirname -- "$0")/../../bin/{name}" "$@"
"""


def shared(folder, pattern='*'):
    """The files of `folder` for share/cube_sim, or nothing where there are none."""
    files = sorted(str(path) for path in Path(folder).glob(pattern) if path.is_file())
    return [(f'share/{PACKAGE}/{Path(folder).name}', files)] if files else []


def wheel_with_launchers(command):
    """The wheel command, with a launcher in lib/cube_sim for each executable."""

    class WheelWithLaunchers(command):
        def run(self):
            folder = Path(self.bdist_dir).parent / 'ros2_run'
            folder.mkdir(parents=True, exist_ok=True)
            for name in EXECUTABLES:
                launcher = folder / name
                launcher.write_text(LAUNCHER.format(name=name))
                launcher.chmod(0o755)
            launchers = [str(folder / name) for name in EXECUTABLES]
            self.distribution.data_files.append((f'lib/{PACKAGE}', launchers))
            super().run()

    return {'bdist_wheel': WheelWithLaunchers}


setup(
    name=PACKAGE,
    version='0.1.0',
    description='A physics simulator of thrown cubes on a plane, as a ROS 2 node',
    author='cube_sim maintainers',
    author_email='cube_sim@example.org',
    maintainer='cube_sim maintainers',
    maintainer_email='cube_sim@example.org',
    license='Apache-2.0',
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed', 'scenarios/*.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        *shared(f'{PACKAGE}/scenarios', '*.yaml'),
        *shared('msg_examples'),
        *shared('rviz'),
        *shared('foxglove'),
    ],
    # The first two are ROS 2 Jazzy itself, for a machine without ROS. Under colcon, ROS is there
    # already (package.xml) and nothing looks at these names: setuptools' scripts load their
    # entry point through importlib.metadata, which checks no requirements.
    install_requires=[
        'ros-jazzy-rclpy[fastrtps]',
        'ros-jazzy-common-interfaces',
        'lz4',
        'mcap>=1.5',
        'llvmlite>=0.44',
        'numba>=0.61',
        'numpy>=1.26',
        'pyyaml',
        'rich',
        'zstandard',
    ],
    extras_require={
        'parquet': ['pyarrow'],
        'plot': ['matplotlib'],
        # colcon test runs pytest because it is named here.
        'test': [
            'hypothesis',
            'mcap-ros2-support',
            'mypy',
            'pytest',
            'pytest-timeout',
            'pytest-xdist',
            'rosbags',
            'ruff',
            'types-PyYAML',
        ],
        # The page in the browser.
        'web': ['trimesh', 'viser>=1.1', 'websockets'],
    },
    entry_points={
        'console_scripts': [f'{name} = {target}' for name, target in EXECUTABLES.items()],
    },
    cmdclass=wheel_with_launchers(bdist_wheel) if bdist_wheel else {},
    zip_safe=False,
)
