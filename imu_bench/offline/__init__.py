# SPDX-License-Identifier: Apache-2.0
"""Everything that works on a finished recording, on any computer, without ROS."""
