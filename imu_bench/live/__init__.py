# SPDX-License-Identifier: Apache-2.0
"""What runs a bench live without ROS: the processes that read sensors, recording without nodes."""
