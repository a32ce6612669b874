# SPDX-License-Identifier: Apache-2.0
"""
What a machine and a bench lack: buses, permissions, chips that answer, and room on the wires.

`machine` looks at device files, `probing` asks chips who they are, `demand` finds out what a
driver does on its wire, `load` predicts from that what a bus makes of all its sensors, and
`checkup` puts it together.  `minute` lets a bench stand still, `resting` judges what came;
`setup` is the files that a computer needs.
"""
