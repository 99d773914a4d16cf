#!/usr/bin/env escript
%% A process reads, another drives; the port is opened again when it is gone.
-mode(compile).

main(_) ->
    {Port, Reader} = connect(),
    drive(0, Port, Reader).

connect() ->
    Name = os:getenv("SIM_R150_PORT"),
    %% It would be made where there is none.
    case element(1, file:read_file_info(Name)) =:= ok andalso file:open(Name, [raw, binary, read, write]) of
        {ok, Port} ->
            os:cmd("stty raw -echo 115200 <" ++ Name),
            Owner = self(),
            {Port, spawn(fun() -> listen(Owner, Name) end)};
        _ ->
            timer:sleep(30),
            connect()
    end.

listen(Owner, Name) ->
    {ok, Input} = file:open(Name, [raw, binary, read]),
    listen(Owner, Input, 0).

listen(Owner, Input, Count) ->
    case file:read(Input, 1) of
        {ok, Bytes} -> listen(Owner, Input, Count + byte_size(Bytes));
        _ -> file:close(Input), Owner ! {gone, self(), Count}
    end.

drive(25, Port, _) ->
    file:write(Port, motors()),
    timer:sleep(200),
    io:format("processors ~b~n", [erlang:system_info(logical_processors_available)]);
drive(Step, Port, Reader) ->
    _ = file:write(Port, motors()),
    receive
        {gone, Reader, Count} ->
            file:close(Port),
            {Next, Other} = connect(),
            At = erlang:monotonic_time(microsecond) - erlang:system_info(start_time) div 1000,
            io:format("came back in step ~b with ~b bytes at ~b~n", [Step, Count, At]),
            drive(Step + 1, Next, Other)
    after 100 -> drive(Step + 1, Port, Reader)
    end.

motors() -> <<16#aa, 16#55, 4, 16#12, 16#2c, 1, 16#2c, 1, 16#1e, 16#b4>>.
