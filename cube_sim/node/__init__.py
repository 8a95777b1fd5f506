"""
`sim_node`: the simulation as a ROS 2 node.

    topics        names, types and quality of service
    parameters    every parameter declared once; the README's table is made from it
    node          SimNode: publishers, services and parameters around a Simulation
    outlet        where messages go: to publishers, and to the recorder
    diagnostics   how the run is going, as diagnostic_msgs
    live_line     the same for a person at a terminal
    main          the executable
"""
