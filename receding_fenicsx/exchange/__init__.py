r"""Systems from and to other programs.

A finite element program gives the stiffness $A$ of a body, or of its retained freedoms, and nodal
forces $f_k$ of its loads (``formats``). ``importing.import_system`` eliminates the freedoms that
are not of the contact, $K = A_{CC} - A_{CI} A_{II}^{-1} A_{IC}$ and
$r^*_k = A_{CI} A_{II}^{-1} f_{k,I} - f_{k,C}$ (eq. 11), turns to the directions $t$, $n$ of the
contact, and finds the rigid motions that $K$ does not resist; it refuses matrices that are not
symmetric, indefinite or leave other motions free than the specification says.
``importing.export_matrices`` writes systems as MatrixMarket, ``reduced`` models for dynamics.
"""
