// The page of an animation: runs that stand in it.

open(JSON.parse($("runs").textContent).map((data) => new Run(data)));
begin();
