"""
What recordings say: the run that a bag holds, simulated again, measured, compared.

    timeline      the messages of a run as typed moments, in order
    replay        a world brought through those moments, step by step
    verification  every recorded pose against the same pose simulated again
    comparison    where two recordings part
    run           findings about a run, by the best way that its bag allows:
    observation     simulated again and watched step by step, exact
    estimation      from recorded poses alone (sampling, flights; how well: error_bars)
    findings      what was found: cubes, bounces, trace (summary: in few numbers)
    bounces       what a bounce says of restitution and friction
    energy        of cubes, and what the integrator does to it
    touching      where cubes touch the plane
    rows          the motion as a stream of states, for tables

Knows physics, messages and bags; draws nothing and prints nothing.
"""
