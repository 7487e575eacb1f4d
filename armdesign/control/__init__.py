"""How far and how calmly a controller can move the arm: margins, gains and bandwidth, per pose."""
