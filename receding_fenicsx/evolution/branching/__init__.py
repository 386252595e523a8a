"""All branches of a load history: every path that the contact may take from rest.

1. The history is played with the first continuation at every choice; the choices are noted
   (:class:`~receding_fenicsx.interface.branches.choice.Chooser`).
2. For each choice on it and each continuation that was not taken, the history is played again with
   the same choices up to there and then this one (:func:`tree.branches`), and so on with its
   choices. Each branch is a :class:`~receding_fenicsx.evolution.record.Record` of its own.
3. A branch that ends where no quasi-static path leads on keeps its record up to there.
"""
