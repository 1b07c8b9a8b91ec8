# Turns a file into a C++ source that holds its bytes, whatever they are and however many:
#
#   include(host_sim/report/embed.cmake)
#   esmc_embed(<target> <file> <symbol>)
#
# compiles into <target> a definition of `const std::string_view esmc::host::<symbol>`. An array of character
# literals is used, because string literals are limited to 64 KiB by the standard and some compilers.

if(CMAKE_SCRIPT_MODE_FILE STREQUAL CMAKE_CURRENT_LIST_FILE)  # build time: cmake -D input= output= symbol= -P
  file(READ "${input}" bytes HEX)
  string(REGEX REPLACE "(................................)" "\\1\n" bytes "${bytes}")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "'\\\\x\\1'," bytes "${bytes}")
  file(WRITE "${output}" "// Generated from ${input} by embed.cmake.
#include <string_view>

namespace esmc::host {
namespace {
constexpr char bytes[] = {
${bytes}};
}  // namespace

extern const std::string_view ${symbol};
constinit const std::string_view ${symbol}{bytes, sizeof bytes};
}  // namespace esmc::host
")
  return()
endif()

set(ESMC_EMBED_SCRIPT "${CMAKE_CURRENT_LIST_FILE}")

function(esmc_embed target input symbol)
  get_filename_component(input "${input}" ABSOLUTE)
  set(output "${CMAKE_CURRENT_BINARY_DIR}/${symbol}.cpp")
  add_custom_command(
    OUTPUT "${output}"
    COMMAND "${CMAKE_COMMAND}" "-Dinput=${input}" "-Doutput=${output}" "-Dsymbol=${symbol}" -P "${ESMC_EMBED_SCRIPT}"
    DEPENDS "${input}" "${ESMC_EMBED_SCRIPT}"
    COMMENT "Embedding ${input}"
    VERBATIM)
  target_sources(${target} PRIVATE "${output}")
endfunction()
