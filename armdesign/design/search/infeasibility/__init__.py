"""Why no design was found: requirements that exclude each other, and by how much to relax them.

The elastic programme finds the design that misses some requirements least. By it irreducible
infeasible subsets are found and a relaxation that resolves all of them, with bores and rods on the
grid of a drawing; the refusal tries whether these amounts give a design and says them. They are
sought least, in a search that is local: no smaller ones are proved to fail.
"""
