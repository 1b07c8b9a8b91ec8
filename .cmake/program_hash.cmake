# Writes OUT, the hash of FILES as a C++ source: which build a journal of `esmc sweep` is of.
set(all "")
foreach(file IN LISTS FILES)
  file(SHA256 ${file} one)
  string(APPEND all ${one})
endforeach()
string(SHA256 all "${all}")
file(WRITE ${OUT} "#include \"host_sim/sweep/journal.hpp\"\nconst char* const esmc::host::program_hash = \"${all}\";\n")
