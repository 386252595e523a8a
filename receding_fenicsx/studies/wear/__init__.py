r"""Wear: growth of the gap by frictional dissipation, in steps of many cycles.

The depth that a cycle wears off at node i is $c_i E_i / m_i$, with its dissipation $E_i$ in the
limit cycle and its weight $m_i$. The condensed stiffness stays, only the gap grows:

1. :class:`~receding_fenicsx.studies.wear.steps.NodePairs` grows the gap along an exact leg, on
   which it acts like an interference, and plays cycles until they repeat. The depths over many
   cycles are those of implicit Euler: with the slip of a cycle given, a normal contact problem with
   one added compliance a node.
2. :class:`~receding_fenicsx.studies.wear.steps.Convected` takes its place where two half-planes
   slide grossly by a stroke that is not small against the contact.
3. :func:`~receding_fenicsx.studies.wear.steps.advance` compares one step with two halves, rejects
   it where they differ, and extrapolates.
4. :func:`~receding_fenicsx.studies.wear.study.wear` does so for a scene, with a folder.
"""
