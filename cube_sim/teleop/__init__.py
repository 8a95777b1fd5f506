"""
`teleop_key`: the report's keyboard commands in a terminal.

    keys      KeyReader: the bytes of a terminal as names of keys; the layouts
    flight    Flight: keys that come and come again as a velocity
    screen    what is shown, as lines of text
    terminal  Terminal: taken over and given back, whatever happens
    main      the executable
"""
