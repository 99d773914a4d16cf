*** Settings ***
Library           Process
Library           Vehicle.py
Test Setup        Start Vehicle And Client
Test Teardown     Run Keywords    Terminate All Processes    AND    End Vehicle

*** Test Cases ***
Stops At The Emergency Stop
    Until    truth.speed_mps > 0.4    within=60 s
    Operator    emergency_stop    ${True}
    Until    truth.at_rest    within=5 s
    Client Report Should Be Empty

Gives Up When No Reply Comes
    Until    truth.speed_mps > 0.4    within=60 s
    Fault    mute    direction=to-client
    ${client} =    Wait For Process    timeout=60 s
    Should Contain    ${client.stderr}    no answer
    Until    truth.at_rest    within=60 s

*** Keywords ***
Start Vehicle And Client
    ${port} =    Start Vehicle    r150
    Start Process    ${{ sys.executable }}    ${CURDIR}/client.py    ${port}
