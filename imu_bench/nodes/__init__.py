# SPDX-License-Identifier: Apache-2.0
"""
Thin ROS 2 shells around the bench: sensors, analysis, recorder.

Each executable is a small module ``<name>_node`` whose `main` starts the class
of module ``<name>`` with `imu_bench.nodes.spinning.run`, which imports that class
late: so a machine without ROS 2 gets a sentence, not a traceback.
"""
