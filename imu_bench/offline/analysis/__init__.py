# SPDX-License-Identifier: Apache-2.0
"""What is measured on recordings: every metric of every axis, and what qualifies it."""
