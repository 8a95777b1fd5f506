"""
`web_view`: the scene in a browser, live or from a bag.

    address    where the page is served, checked before anything else
    axes       the conventions of cameras: the page's and ROS's
    stage      Stage: ground, cubes and cameras on the page
    heights    Heights: the plot of the last cubes' heights
    run        Run: what the topics of a simulator say, in the order that is to be shown
    thrower    Thrower: places the camera, then throws, one page after the other
    panel      Panel: settings and switches, kept as the simulator has them
    visitor    Visitor: one open page, its keys and its camera
    live       Live: all of these around a SimulatorLink
    playback   Recorded: the frames of a bag
    player     Player: a bag on the page, with a time slider
    export     a bag as one HTML file
    game       simulator and page in one process
    main       the executable

The page is made with viser (the extra `web`); nothing outside of this folder imports it.
"""
