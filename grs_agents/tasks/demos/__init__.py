"""Demonstrations: the expert's episodes at a control rate, replayed, as data sets of LeRobot, robomimic and Minari."""
