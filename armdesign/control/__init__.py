"""Control of the arm: margins, gains and bandwidth, per pose."""
